// The run as lines and faces: boxes, supporting planes, the path of the camera.

const EDGES = [];
for (let a = 0; a < 8; a++) for (const bit of [1, 2, 4]) if (!(a & bit)) EDGES.push([a, a | bit]);
const SIDES = [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]];

// About this many pyramids of the camera show its path without hiding the scene.
const PYRAMIDS = 28;
const DASH_M = 0.03;

const colorOf = (hex, alpha) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255).concat(alpha);

const GROUNDS = {
  dark: { sky: [0.075, 0.09, 0.115], floor: [0.035, 0.043, 0.058], halo: [0.03, 0.04, 0.05, 0.5], path: "#dfe6ef" },
  light: { sky: [0.985, 0.988, 0.992], floor: [0.88, 0.9, 0.925], halo: [0.06, 0.07, 0.09, 0.55], path: "#2b3442" },
};

/** Size of the pyramids of the camera, metres: a fraction of the distance to the objects. */
function pyramidSize() {
  const centers = data.objects.map((object) => object.center);
  const first = frames.length ? poseOf(0).place : [0, 0, 0];
  const away = centers.map((center) => norm(sub(center, first))).sort((a, b) => a - b);
  return clamp(0.06 * (away[away.length >> 1] || 1.5), 0.03, 0.3);
}

/** Frames with a pyramid: the next one follows when the camera has moved far enough from the previous one. */
function milestones(size) {
  let length = 0;
  for (let i = 1; i < frames.length; i++) length += norm(sub(poseOf(i).place, poseOf(i - 1).place));
  const step = Math.max(1.6 * size, length / PYRAMIDS);
  const found = frames.length ? [0] : [];
  for (let i = 1, gone = 0; i < frames.length; i++) {
    gone += norm(sub(poseOf(i).place, poseOf(i - 1).place));
    const clear = found.every((j) => norm(sub(poseOf(i).place, poseOf(j).place)) > size);
    if (gone >= step && clear) {
      found.push(i);
      gone = 0;
    }
  }
  return found;
}

/** The four corners of the image at a depth in front of a camera, clockwise from the upper left. */
function imageCorners(pose, depth, lens = data.camera) {
  const { fx, fy, cx, cy, width, height } = lens;
  return [[0, 0], [width, 0], [width, height], [0, height]].map(([x, y]) =>
    [[pose.right, (x - cx) / fx], [pose.down, (y - cy) / fy], [pose.ahead, 1]].reduce(
      (p, [way, share]) => add(p, scale(way, share * depth)),
      pose.place,
    ),
  );
}

function pyramidLines(pose, depth, color, width, lens = data.camera) {
  const image = imageCorners(pose, depth, lens);
  const style = [width, 0];
  return image.flatMap((corner, i) => [
    [pose.place, corner, color, style],
    [corner, image[(i + 1) % 4], color, style],
  ]);
}

/** Triangles of a convex polygon, such as the outline of a plane or of a side: a fan. */
function fan(polygon, color) {
  return polygon.slice(2).flatMap((corner, i) => [[polygon[0], color], [polygon[i + 1], color], [corner, color]]);
}

class Scene {
  constructor(renderer, state) {
    this.renderer = renderer;
    this.state = state;
    this.size = pyramidSize();
    this.milestones = milestones(this.size);
    this.steps = null;
    this.points = null;
    this.ruler = null;
    this.boxes = new Map(data.objects.map((object) => [object.label, corners(object)]));
  }

  async load() {
    this.setPoints(await unpackPoints());
  }

  setPoints(points) {
    this.points = points;
    this.steps = points.steps;
    this.facing = facingOf(points, this.seenFrom());
    this.colorPoints();
  }

  /** Positions from which the map was seen. */
  seenFrom() {
    return viewpoints();
  }

  /** Whether walls and ceilings that are seen from behind are left out; the camera itself sees none. */
  get cuts() {
    return this.state.layers.cut && !this.state.follow;
  }

  /** Give the points of likely objects the color of their label. */
  colorPoints() {
    if (!this.points) return;
    const { label: labels } = this.points;
    const own = new Uint8Array(3 * labels.length);
    const objects = data.objects.filter((object) => isLikely(this.state, object));
    const colors = new Map(objects.map(({ label, color }) => [label, colorOf(color, 1).map((c) => 255 * c)]));
    labels.forEach((label, i) => {
      const color = label && colors.get(label);
      if (color) own.set(color.slice(0, 3), 3 * i);
    });
    this.renderer.setPoints(this.points, own, this.facing);
  }

  /** Rebuild all lines and faces. */
  update() {
    const ground = GROUNDS[this.state.theme];
    const { ratio } = this.renderer;
    this.renderer.setLines("outlines", this.planeLines(ground, ratio));
    this.renderer.setFaces("planes", this.planeFaces(ground));
    this.renderer.setLines("furniture", this.furnitureLines(ground, ratio));
    this.renderer.setLines("path", this.pathLines(ground, ratio));
    this.updateFrame();
  }

  /** Rebuild only the parts that depend on the frame and on the selection: fast enough for sliders. */
  updateFrame() {
    const ground = GROUNDS[this.state.theme];
    const { ratio } = this.renderer;
    this.renderer.setLines("boxes", this.boxLines(ratio), true);
    this.renderer.setFaces("sides", this.boxSides());
    this.renderer.setLines("changes", this.changeLines(ground, ratio), true);
    this.renderer.setLines("camera", this.cameraLines(ground, ratio));
    this.renderer.setFaces("image", this.cameraFaces(ground));
    this.updateRuler();
  }

  updateRuler() {
    if (this.ruler) this.renderer.setLines("ruler", this.ruler.lines(colorOf(GROUNDS[this.state.theme].path, 1), this.renderer.ratio), true);
  }

  stateOf(object) {
    const { frame } = this.state;
    if (isFurniture(object)) return "seen";
    if (!isWanted(this.state, object)) return "unknown";
    return frame === null ? "seen" : stateIn(object, frames[frame]);
  }

  boxLines(ratio) {
    const looks = { seen: [1, 2, 0], hidden: [0.85, 1.4, DASH_M] };
    return data.objects.flatMap((object) => {
      const look = looks[this.stateOf(object)];
      const chosen = object.label === this.state.selected;
      if (!look && !chosen) return [];
      const [alpha, width, dash] = look || [0.5, 1.2, DASH_M / 3];
      const box = this.boxes.get(object.label);
      const color = colorOf(object.color, alpha);
      return EDGES.map(([a, b]) => [box[a], box[b], color, [ratio * (chosen ? width + 1.6 : width), dash]]);
    });
  }

  boxSides() {
    return data.objects.flatMap((object) => {
      const chosen = object.label === this.state.selected;
      if (!chosen && this.stateOf(object) !== "seen") return [];
      const box = this.boxes.get(object.label);
      const color = colorOf(object.color, chosen ? 0.16 : 0.05);
      return SIDES.flatMap((side) => fan(side.map((corner) => box[corner]), color));
    });
  }

  /** The former places of moved and removed objects, and arrows along their moves. */
  changeLines(ground, ratio) {
    return changesShown(this.state).filter((one) => one.from && ["moved", "gone"].includes(one.change)).flatMap((one) => {
      const color = colorOf(one.color, one.label === this.state.selected ? 1 : 0.75);
      const box = corners({ ...one, center: one.from });
      const width = ratio * (one.label === this.state.selected ? 2.4 : 1.4);
      const ghost = EDGES.map(([a, b]) => [box[a], box[b], color, [width, DASH_M / 2]]);
      return one.to ? ghost.concat(this.arrow(one.from, one.to, color, 1.6 * width)) : ghost;
    });
  }

  /** An arrow between two places; its head has four strokes, so that it is visible from all sides. */
  arrow(from, to, color, width) {
    const way = sub(to, from);
    const length = norm(way);
    if (length < 1e-6) return [];
    const back = scale(way, -Math.min(0.25, 0.06 / length));
    const across = cross(way, up);
    const sides = [up, scale(across, 1 / (norm(across) || 1))].map((side) => scale(side, 0.5 * norm(back)));
    const style = [width, 0];
    const head = sides.flatMap((side) => [side, scale(side, -1)]).map((side) => [to, add(to, add(back, side)), color, style]);
    return [[from, to, color, style], ...head];
  }

  planeLines(ground, ratio) {
    const color = colorOf(ground.path, 0.4);
    return data.planes.flatMap(({ extent }) =>
      extent.map((corner, i) => [corner, extent[(i + 1) % extent.length], color, [1.2 * ratio, 0]]),
    );
  }

  planeFaces(ground) {
    return data.planes.flatMap(({ extent }) => fan(extent, colorOf(ground.path, 0.1)));
  }

  /** Boxes of the furniture that bears the planes: thin and dashed, since furniture is no object. */
  furnitureLines(ground, ratio) {
    const color = colorOf(ground.path, 0.55);
    return furniture.flatMap((piece) => {
      const box = corners(piece);
      return EDGES.map(([a, b]) => [box[a], box[b], color, [1.2 * ratio, DASH_M]]);
    });
  }

  pathLines(ground, ratio) {
    const lines = [];
    const last = new Map(); // the last frame of each camera
    for (let i = 0; i < frames.length; i++) {
      const color = colorOf(ground.path, 0.25 + 0.6 * (i / frames.length)), before = last.get(cameras[i]);
      if (before !== undefined) lines.push([poseOf(before).place, poseOf(i).place, color, [1.6 * ratio, 0]]);
      last.set(cameras[i], i);
    }
    const color = colorOf(ground.path, 0.4);
    return lines.concat(this.milestones.flatMap((i) => pyramidLines(poseOf(i), this.size, color, ratio)));
  }

  cameraLines(ground, ratio) {
    const { frame } = this.state;
    return frame === null ? [] : pyramidLines(poseOf(frame), 2.2 * this.size, colorOf(ground.path, 1), 2.4 * ratio);
  }

  cameraFaces(ground) {
    const { frame } = this.state;
    return frame === null ? [] : fan(imageCorners(poseOf(frame), 2.2 * this.size), colorOf(ground.path, 0.14));
  }

  draw(eye) {
    const { layers, follow, coloring, theme } = this.state;
    const shown = [];
    if (layers.planes) shown.push("planes", "outlines");
    if (layers.furniture) shown.push("furniture");
    if (layers.camera && !follow) shown.push("image", "path", "camera");
    if (layers.boxes) shown.push("sides", "boxes");
    if (layers.changes) shown.push("changes");
    if (this.ruler) shown.push("ruler");
    this.renderer.draw(eye, coloring, GROUNDS[theme], shown, this.cuts);
  }

  /** The object whose box a ray meets; of several the smallest, which otherwise could never be selected. */
  pick(origin, direction) {
    const volume = ({ size }) => size[0] * size[1] * size[2];
    const met = data.objects.filter(
      (object) => this.stateOf(object) !== "unknown" && enterBox(origin, direction, object) !== null,
    );
    return met.sort((a, b) => volume(a) - volume(b))[0] || null;
  }
}
