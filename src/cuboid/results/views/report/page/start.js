// The first point of view: a side from which all labels show and little stands before the objects.

const TURNS = 24;
const PITCHES = [0.6, 0.85, 0.4, 1.1];
// Free margins of the view for toolbar and tags, pixels: left and right, top, bottom.
const MARGINS = [46, 96, 34];
// A label that does not show costs more than any other disadvantage of a side.
const LOST_LABEL = 10;
// Points that test what is hidden, and the picture of distances for that, cells.
const PROBES = 6000;
const PICTURE = [48, 32];

/** The boxes that must be in the view: their corners. */
const cornersShown = (stateOf) => data.objects.filter((object) => stateOf(object) !== "unknown").flatMap(corners);

/** The point of view from a direction that just holds some places. */
function framed(orbit, places, yaw, pitch) {
  const back = orbit.direction(yaw, pitch);
  const right = unit(cross(up, back));
  const high = cross(back, right);
  const { clientWidth: width, clientHeight: height } = orbit.canvas;
  const t = Math.tan(FOV_Y / 2);
  const half = (margin, length) => Math.max(0.3, 1 - (2 * margin) / length);
  const across = t * (width / height) * half(MARGINS[0], width);
  const [above, below] = [t * half(MARGINS[1], height), t * half(MARGINS[2], height)];
  const seen = places.map((place) => [dot(place, right), dot(place, high), dot(place, back)]);
  const reach = (value) => Math.max(...seen.map(value));
  const target = [0, 1].map((k) => (reach((p) => p[k]) - reach((p) => -p[k])) / 2);
  const towards = (reach((p) => p[2]) - reach((p) => -p[2])) / 2;
  let distance = 0;
  for (let i = 0; i < 6; i++) { // the nearer a place, the more it is at the edge: some rounds balance the edges
    const [left, rest] = [-1, 1].map((way) => reach((p) => (way * (p[0] - target[0])) / across + p[2] - towards));
    const [top, bottom] = [reach((p) => (p[1] - target[1]) / above + p[2] - towards), reach((p) => (target[1] - p[1]) / below + p[2] - towards)];
    target[0] += ((rest - left) * across) / 2;
    target[1] += (top - bottom) * ((above * below) / (above + below));
    distance = Math.max(left, rest, top, bottom, 0.3);
  }
  const center = [[right, target[0]], [high, target[1]], [back, towards]].reduce((sum, [way, by]) => add(sum, scale(way, by)), [0, 0, 0]);
  return { yaw, pitch, target: center, distance, fovY: FOV_Y };
}

/** Points of the map without objects, some of them, and the sides from which they were seen. */
function probesOf(scene) {
  if (!scene.points) return [];
  const { label, steps } = scene.points;
  const { low, step_m } = data.points;
  const step = Math.max(1, Math.floor(label.length / PROBES));
  const found = [];
  for (let i = 0; i < label.length; i += step)
    if (!label[i]) found.push({ i, place: [0, 1, 2].map((k) => low[k] + step_m * steps[3 * i + k]) });
  return found;
}

/** The fraction of the objects behind points of the map, which are not cut. */
function hiddenShare(eye, scene, probes, objects) {
  const [width, height] = PICTURE;
  const nearest = new Float32Array(width * height).fill(Infinity);
  const cellOf = ([x, y, , w]) => {
    const [column, row] = [Math.floor((x / w + 1) * 0.5 * width), Math.floor((1 - y / w) * 0.5 * height)];
    return w > eye.near && column >= 0 && row >= 0 && column < width && row < height ? row * width + column : -1;
  };
  for (const { i, place } of probes) {
    if (scene.cuts && isCut(scene.facing, i, sub(eye.place, place))) continue;
    const clip = toClip(eye.clip_world, place);
    const cell = cellOf(clip);
    if (cell >= 0) nearest[cell] = Math.min(nearest[cell], clip[3]);
  }
  const hidden = objects.filter((object) => {
    const clip = toClip(eye.clip_world, object.center);
    const cell = cellOf(clip);
    return cell >= 0 && nearest[cell] < clip[3] - norm(object.size) / 2;
  });
  return hidden.length / Math.max(1, objects.length);
}

/** The best point of view of all labels; of equal ones that nearest to the side of the first camera. */
function startView(orbit, tags, scene) {
  const stateOf = (object) => scene.stateOf(object);
  const places = cornersShown(stateOf);
  const base = orbit.home();
  if (!places.length) return base;
  const objects = data.objects.filter((object) => stateOf(object) !== "unknown");
  const sides = PITCHES.flatMap((pitch) =>
    Array.from({ length: TURNS }, (_, i) => framed(orbit, places, base.yaw + (2 * Math.PI * i) / TURNS, pitch)),
  );
  const nearest = Math.min(...sides.map(({ distance }) => distance));
  const probes = probesOf(scene);
  const costOf = (place) => {
    const eye = orbit.eye(place);
    const shown = tags.arrange(eye, stateOf, []).filter(({ rect, object }) => rect && !isFurniture(object)).length;
    const turned = Math.abs(Math.atan2(Math.sin(place.yaw - base.yaw), Math.cos(place.yaw - base.yaw))) / Math.PI;
    const hidden = hiddenShare(eye, scene, probes, objects);
    return LOST_LABEL * (objects.length - shown) + 3 * hidden + turned + place.distance / nearest + Math.abs(place.pitch - PITCHES[0]);
  };
  return sides.map((place) => [costOf(place), place]).sort((a, b) => a[0] - b[0])[0][1];
}
