// The data of the page, written by Python; see summary.py and points.py for the format.

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

const frames = new Int32Array(bytesOf(data.frames).buffer);
const poses = new Float32Array(bytesOf(data.poses).buffer);
/** Number of the camera of a rig that took each frame; without a rig 0. */
const cameras = data.rig ? new Int32Array(bytesOf(data.rig.cameras).buffer) : new Int32Array(frames.length);
const changed = data.changes || []; // a run in progress has none yet
const happened = data.events || []; // the same
const objectOf = new Map(data.objects.map((object) => [object.label, object]));
const furniture = data.furniture || []; // boxes of the furniture that bears the planes; it is no object
const isFurniture = ({ kind }) => kind === "support";

/** Pose (camera to world) of the i-th used frame: position, and axes as columns. */
function poseOf(i) {
  const m = poses.subarray(12 * i, 12 * i + 12);
  return {
    place: [m[3], m[7], m[11]],
    right: [m[0], m[4], m[8]],
    down: [m[1], m[5], m[9]],
    ahead: [m[2], m[6], m[10]],
  };
}

/** The up direction in the world; without a plane, the first camera is assumed to be upright. */
const up = data.up || (frames.length ? scale(poseOf(0).down, -1) : [0, -1, 0]);

/** Whether an object is seen in a frame, hidden but in the map, or not in the map yet. */
function stateIn(object, frame) {
  if (!object.spans.length || frame < object.spans[0][0]) return "unknown";
  return object.spans.some(([from, to]) => from <= frame && frame <= to) ? "seen" : "hidden";
}

/** A number of centimetres, metres or milliseconds as the page shows it. */
const cm = (metres) => (100 * metres).toFixed(1);
const fixed = (value, digits) => value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1");
const likely = (object) => fixed(object.probability, 2);

// Half the 95 % interval of a size, in standard deviations; from this half interval on, metres, a size has no decimal
// place of a centimetre; and the smallest one that is shown, metres.
const SIGMAS_95 = 1.96;
const COARSE_M = 0.01;
const FINEST_M = 0.001;

/** A length as text: whole centimetres where half its 95 % interval is 1 cm or more. */
const worth = (metres, within) => (within >= COARSE_M ? (100 * metres).toFixed(0) : cm(metres));
const sigmasOf = ({ size_sigma_m: sigmas }) => (sigmas && sigmas.length ? sigmas : null);

/** The sides of a box in centimetres; with `errors`, each with half its 95 % interval, if that is known. */
function sizeOf(object, errors = false) {
  const sigmas = sigmasOf(object);
  const side = (metres, k) => {
    if (!sigmas) return cm(metres);
    const within = Math.max(SIGMAS_95 * sigmas[k], FINEST_M);
    return worth(metres, within) + (errors ? ` ± ${worth(within, within)}` : "");
  };
  return object.size.map(side).join(" × ");
}

/** How many sides of an object a camera saw, without its bottom; "" if that is unknown. */
function sidesSeen(object) {
  if (!sigmasOf(object)) return "";
  const seen = object.sides_seen || [];
  const around = ["+x", "-x", "+y", "-y"].filter((side) => seen.includes(side)).length;
  const count = around + (seen.includes("+z") ? 1 : 0);
  return `${count} of 5${around < 4 ? "; back not seen" : ""}`;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Sum up the differences between consecutive points: returns the values of the points. */
function summed(bytes, column, count) {
  const values = new Uint8Array(count);
  for (let i = 0, sum = 0; i < count; i++) values[i] = sum += bytes[column * count + i];
  return values;
}

function summedPair(bytes, column, count) {
  const values = new Uint16Array(count);
  for (let i = 0, sum = 0; i < count; i++)
    values[i] = sum += bytes[column * count + i] | (bytes[(column + 1) * count + i] << 8);
  return values;
}

/**
 * The point map: steps (3 n, 16 bit, from `low`), look (4 n, 8 bit: red, green, blue, heat), label (n, 16 bit).
 */
async function unpackPoints() {
  const { count, content } = data.points;
  const bytes = await inflate(bytesOf(content));
  const places = [0, 2, 4].map((column) => summedPair(bytes, column, count));
  const looks = [6, 7, 8, 9].map((column) => summed(bytes, column, count));
  const steps = new Uint16Array(3 * count);
  const look = new Uint8Array(4 * count);
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < 3; k++) steps[3 * i + k] = places[k][i];
    for (let k = 0; k < 4; k++) look[4 * i + k] = looks[k][i];
  }
  return { steps, look, label: summedPair(bytes, 10, count) };
}

/** An event of an object, in words. */
function wordsOf({ event, metres }) {
  return event === "moved" ? `moved ${cm(metres)} cm` : event;
}

/** The label and the name of an object. */
function titleOf(object) {
  return object.name ? `#${object.label} ${object.name}` : `#${object.label}`;
}

/** The furniture that bears a plane, as text after the name of the plane: ", table #7"; empty if there is none. */
function bearerOf(plane) {
  const piece = furniture.find(({ planes = [] }) => planes.includes(plane));
  return piece ? `, ${piece.name} #${piece.label}` : "";
}

/** The label in its color, the same on the whole page. */
function chip(object, ...rest) {
  const style = `background:${object.color};color:${object.ink}`;
  return element("span", { class: "chip", style, title: titleOf(object) }, titleOf(object), ...rest);
}
