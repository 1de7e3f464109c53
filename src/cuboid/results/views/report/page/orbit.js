// The eye turns about a target, and the up direction of the world always points up on the screen.

const FOV_Y = (42 * Math.PI) / 180;
const STEEPEST = 1.55;
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

/** Quantile `share` of values of objects, weighted by their frames seen: briefly seen objects count little. */
function middleOf(values, share) {
  const order = values.map((value, i) => [value, data.objects[i].frames_seen]).sort((a, b) => a[0] - b[0]);
  let left = share * order.reduce((sum, [, weight]) => sum + weight, 0);
  return (order.find(([, weight]) => (left -= weight) <= 0) || order[order.length - 1])[0];
}

class Orbit {
  constructor(canvas, changed, grabbed) {
    this.canvas = canvas;
    this.changed = changed;
    this.grabbed = grabbed;
    this.east = sideways(up);
    this.north = cross(up, this.east);
    this.span = this.spanOfScene();
    this.place = this.home();
    this.flight = 0;
    this.pointers = new Map();
    this.listen();
  }

  spanOfScene() {
    const { step_m, low } = data.points;
    const places = data.objects.map((object) => object.center).concat(frames.length ? [poseOf(0).place] : [low]);
    const reach = places.map((place) => norm(sub(place, places[0])));
    return 2 * Math.max(...reach, 1) + Math.min(60, 4096 * step_m);
  }

  /** The whole scene from the first camera position, slightly higher. */
  home() {
    const first = frames.length ? poseOf(0) : { place: [0, 0, -2], ahead: [0, 0, 1] };
    let target = add(first.place, scale(first.ahead, 1.5));
    let radius = 0.6;
    if (data.objects.length) {
      target = [0, 1, 2].map((k) => middleOf(data.objects.map((object) => object.center[k]), 0.5));
      const reach = data.objects.map((object) => norm(sub(object.center, target)) + norm(object.size) / 2);
      radius = clamp(1.25 * middleOf(reach, 0.6), 0.4, 3);
    }
    const { yaw } = this.anglesOf(sub(first.place, target));
    const narrow = Math.max(1, this.canvas.clientHeight / Math.max(1, this.canvas.clientWidth));
    return { yaw: yaw - 0.35, pitch: 0.6, target, distance: (narrow * radius) / Math.sin(FOV_Y / 2), fovY: FOV_Y };
  }

  anglesOf(way) {
    const ahead = unit(way);
    return {
      yaw: Math.atan2(dot(ahead, this.north), dot(ahead, this.east)),
      pitch: clamp(Math.asin(clamp(dot(ahead, up), -1, 1)), -STEEPEST, STEEPEST),
    };
  }

  /** The direction from the target to the eye. */
  direction(yaw, pitch) {
    const level = add(scale(this.east, Math.cos(yaw)), scale(this.north, Math.sin(yaw)));
    return add(scale(level, Math.cos(pitch)), scale(up, Math.sin(pitch)));
  }

  eye({ yaw, pitch, target, distance, fovY } = this.place) {
    const place = add(target, scale(this.direction(yaw, pitch), distance));
    const near = clamp(0.03 * distance, 0.01, 0.3);
    const far = distance + this.span;
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    const view = lookAt(place, target, up);
    return { place, view, near, far, fovY, aspect, clip_world: multiply(perspective(fovY, aspect, near, far), view) };
  }

  /** The ray through a point of the canvas in CSS pixels. */
  ray(x, y) {
    const { place, view, fovY, aspect } = this.eye();
    const t = Math.tan(fovY / 2);
    const right = ((2 * x) / this.canvas.clientWidth - 1) * t * aspect;
    const high = (1 - (2 * y) / this.canvas.clientHeight) * t;
    const world = (k) => view[4 * k] * right + view[4 * k + 1] * high - view[4 * k + 2];
    return { origin: place, direction: unit([world(0), world(1), world(2)]) };
  }

  set(place) {
    cancelAnimationFrame(this.flight);
    this.place = { ...this.place, ...place };
    this.changed();
  }

  fly(place, milliseconds = 500) {
    cancelAnimationFrame(this.flight);
    const from = this.place;
    const to = { ...from, ...place };
    const turn = to.yaw - from.yaw;
    to.yaw = from.yaw + turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    const begun = performance.now();
    const step = (now) => {
      const share = calm.matches || !milliseconds ? 1 : clamp((now - begun) / milliseconds, 0, 1);
      const s = share * share * (3 - 2 * share);
      const between = (name) => from[name] + (to[name] - from[name]) * s;
      this.place = { target: mix(from.target, to.target, s) };
      for (const name of ["yaw", "pitch", "distance", "fovY"]) this.place[name] = between(name);
      this.changed();
      if (share < 1) this.flight = requestAnimationFrame(step);
    };
    step(begun);
  }

  /** The point of view of a camera. */
  behind(pose, lens = data.camera) {
    const { fx, fy, width, height } = lens;
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    const t = Math.max(height / (2 * fy), width / (2 * fx) / aspect);
    const distance = 1.2;
    return {
      ...this.anglesOf(scale(pose.ahead, -1)),
      target: add(pose.place, scale(pose.ahead, distance)),
      distance,
      fovY: 2 * Math.atan(t),
    };
  }

  turn(dx, dy) {
    const { yaw, pitch } = this.place;
    this.set({ yaw: yaw - 0.006 * dx, pitch: clamp(pitch + 0.006 * dy, -STEEPEST, STEEPEST) });
  }

  move(dx, dy) {
    const { target, distance, fovY } = this.place;
    const { view } = this.eye();
    const metres = (2 * distance * Math.tan(fovY / 2)) / this.canvas.clientHeight;
    const along = (row, by) => scale([view[row], view[4 + row], view[8 + row]], by * metres);
    this.set({ target: add(target, add(along(0, -dx), along(1, dy))) });
  }

  zoom(factor) {
    this.set({ distance: clamp(this.place.distance * factor, 0.05, 2 * this.span), fovY: FOV_Y });
  }

  listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.grabbed();
      const lines = event.deltaMode === 1 ? 16 : 1;
      this.zoom(Math.exp(clamp(event.deltaY * lines, -200, 200) * 0.0016));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (!dx && !dy) return;
    this.grabbed();
    const other = [...this.pointers].find(([id]) => id !== event.pointerId);
    this.pointers.set(event.pointerId, now);
    if (other) {
      const apart = (p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) || 1;
      this.zoom(apart(before) / apart(now));
      this.move(dx / 2, dy / 2);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) this.move(dx, dy);
    else this.turn(dx, dy);
  }
}
