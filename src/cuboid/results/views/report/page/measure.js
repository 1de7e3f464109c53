// The scale bar, and the ruler between two points of the map.

// A click takes the nearest point of the map within this distance in pixels.
const REACH_PX = 7;
const BAR_PX = 130;
// Minimum width, in pixels, for the hint about the mouse beside the scale bar.
const HINT_FITS_PX = 560;

/** A length in a suitable unit: metres from 1 m, centimetres from 1 cm, else millimetres. */
function lengthOf(metres, digits = 1) {
  const [value, unitName] = metres >= 1 ? [metres, "m"] : metres >= 0.01 ? [100 * metres, "cm"] : [1000 * metres, "mm"];
  return `${value.toFixed(metres >= 1 && digits ? 2 : digits)} ${unitName}`;
}

/** Show a scale bar for the distance of the target about which the view turns. */
function showScale(orbit, height) {
  const { distance, fovY } = orbit.place;
  const pixels = height / (2 * distance * Math.tan(fovY / 2)); // per metre
  const power = 10 ** Math.floor(Math.log10(BAR_PX / pixels));
  const metres = [5, 2, 1].map((step) => step * power).find((length) => length * pixels <= BAR_PX);
  find("scale").querySelector("i").style.width = `${(metres * pixels).toFixed(1)}px`;
  find("scale").querySelector("span").textContent = lengthOf(metres, 0);
}

/** Show the hint about the mouse if the scale bar leaves room for it. */
function showHint(width) {
  find("notice").hidden = width < HINT_FITS_PX;
}

/** The first point of the map along a ray, within an angle in radians; null if there is none. `facing`: leave out cut points. */
function pointAt(steps, origin, direction, reach, facing = null) {
  const { low, step_m, spacing_m } = data.points;
  let nearest = Infinity;
  let found = null;
  for (let i = 0; i < steps.length; i += 3) {
    const x = low[0] + step_m * steps[i] - origin[0];
    const y = low[1] + step_m * steps[i + 1] - origin[1];
    const z = low[2] + step_m * steps[i + 2] - origin[2];
    const along = x * direction[0] + y * direction[1] + z * direction[2];
    if (along <= 0.01) continue;
    const aside = Math.sqrt(Math.max(0, x * x + y * y + z * z - along * along));
    if (aside > Math.max(reach * along, 0.75 * spacing_m)) continue;
    if (facing && isCut(facing, i / 3, [-x, -y, -z])) continue;
    const cost = along + 4 * aside; // of two points at about the same distance, prefer the one under the pointer
    if (cost < nearest) [nearest, found] = [cost, [x, y, z]];
  }
  return found && add(found, origin);
}

class Ruler {
  constructor(state, scene, orbit, changed) {
    Object.assign(this, { state, scene, orbit, changed, ends: [], active: false });
    this.label = find("ruler-label");
    this.button = find("ruler");
    this.button.addEventListener("click", () => this.use(!this.active));
  }

  /** Start or stop measuring. */
  use(active) {
    this.active = active;
    this.ends = [];
    this.button.setAttribute("aria-pressed", String(active));
    this.orbit.canvas.classList.toggle("measures", active);
    this.changed();
  }

  /** Handle a click into the scene; the third click starts a new measurement. */
  click(x, y) {
    const { origin, direction } = this.orbit.ray(x, y);
    const reach = (REACH_PX * 2 * Math.tan(this.orbit.place.fovY / 2)) / this.orbit.canvas.clientHeight;
    const end = this.scene.steps && pointAt(this.scene.steps, origin, direction, reach, this.scene.cuts ? this.scene.facing : null);
    if (!end) return;
    this.ends = this.ends.length === 2 ? [end] : [...this.ends, end];
    this.changed();
  }

  /** Lines for the renderer: the segment between the two ends, with a small cross at each end. */
  lines(color, ratio) {
    const arm = 0.012 * this.orbit.place.distance;
    const crosses = this.ends.flatMap((end) =>
      [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((way) => [sub(end, scale(way, arm)), add(end, scale(way, arm)), color, [2.4 * ratio, 0]]),
    );
    return this.ends.length === 2 ? [[...this.ends, color, [2.4 * ratio, 0]], ...crosses] : crosses;
  }

  /** Show the length at the middle of the ruler on the screen. */
  place(eye) {
    const [from, to] = this.ends;
    const clip = to && toClip(eye.clip_world, mix(from, to, 0.5));
    this.label.hidden = !clip || clip[3] < eye.near;
    if (this.label.hidden) return;
    const { clientWidth, clientHeight } = this.orbit.canvas;
    const [x, y] = [(clip[0] / clip[3] + 1) * 0.5 * clientWidth, (1 - clip[1] / clip[3]) * 0.5 * clientHeight];
    this.label.textContent = lengthOf(norm(sub(to, from)));
    this.label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
  }
}
