// The side from which each part of the map was seen: walls and ceilings seen from behind hide the objects.

// Edge of a cell, metres: small enough for one surface, and large enough for the direction of that surface.
const CELL_M = 0.12;
const CELL_SPACINGS = 4;
// A cell needs this many points for a direction.
const LEAST_POINTS = 6;
// A cell is flat if its smallest variance is below this fraction of its middle one; noise of 1 cm gives 0.08.
const FLAT = 0.12;
// Directions of neighbouring cells agree if their mean is longer than this.
const AGREEING = 0.6;
// So many camera positions decide about the side; cosine of the largest angle from the axis of a camera to a point.
const VIEWPOINTS = 100;
const IN_PICTURE = 0.6;

/** Some of a number of places, evenly spread: at most `VIEWPOINTS`. */
function someOf(count, placeOf) {
  const step = Math.max(1, Math.ceil(count / VIEWPOINTS));
  return Array.from({ length: Math.ceil(count / step) }, (_, i) => placeOf(i * step));
}

/** Positions and axes of the camera, evenly along its path. */
function viewpoints() {
  return someOf(frames.length, poseOf);
}

/** The direction of the smallest variance of a symmetric matrix [xx, xy, xz, yy, yz, zz]; null if it is not flat. */
function flatDirection([xx, xy, xz, yy, yz, zz]) {
  const mean = (xx + yy + zz) / 3;
  const off = xy * xy + xz * xz + yz * yz;
  const p = Math.sqrt(((xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2 * off) / 6);
  if (p < 1e-12) return null;
  const [a, b, c] = [xx - mean, yy - mean, zz - mean];
  const half = (a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)) / (2 * p ** 3);
  const angle = Math.acos(clamp(half, -1, 1)) / 3; // the eigenvalues by their trigonometric form (O. Smith, 1961)
  const most = mean + 2 * p * Math.cos(angle);
  const least = mean + 2 * p * Math.cos(angle + (2 * Math.PI) / 3);
  if (least > FLAT * (3 * mean - most - least)) return null;
  const rows = [[xx - least, xy, xz], [xy, yy - least, yz], [xz, yz, zz - least]];
  const crosses = [[0, 1], [0, 2], [1, 2]].map(([i, j]) => cross(rows[i], rows[j]));
  const longest = crosses.sort((u, v) => dot(v, v) - dot(u, u))[0];
  return dot(longest, longest) > 0 ? unit(longest) : null;
}

/** Sums over the points of each cell without an object: count, mean and variances; and the cell of each point. */
function cellsOf({ steps, label }) {
  const { step_m, spacing_m } = data.points;
  const edge = Math.max(1, Math.round(Math.max(CELL_M, CELL_SPACINGS * spacing_m) / step_m));
  const side = Math.ceil(65536 / edge) + 2; // one more on each side for neighbours
  const places = new Map();
  const of = new Int32Array(label.length);
  let sums = new Float64Array(10 * 4096);
  let last = -1;
  let cell = -1;
  for (let i = 0; i < label.length; i++) {
    const [x, y, z] = [steps[3 * i], steps[3 * i + 1], steps[3 * i + 2]];
    const key = ((Math.floor(x / edge) + 1) * side + Math.floor(y / edge) + 1) * side + Math.floor(z / edge) + 1;
    if (key !== last) {
      last = key;
      cell = places.get(key) ?? places.size;
      places.set(key, cell);
      if (10 * cell >= sums.length) {
        const longer = new Float64Array(2 * sums.length);
        longer.set(sums);
        sums = longer;
      }
    }
    of[i] = cell;
    if (label[i]) continue;
    const terms = [1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
    for (let k = 0; k < 10; k++) sums[10 * cell + k] += terms[k];
  }
  return { of, sums, places, side };
}

/** The direction of each cell, towards the camera that has seen it; null for cells without a flat surface. */
function directionsOf({ sums, places }, seenFrom) {
  const { step_m, low } = data.points;
  return Array.from({ length: places.size }, (_, cell) => {
    const [n, x, y, z, ...squares] = sums.subarray(10 * cell, 10 * cell + 10);
    if (n < LEAST_POINTS) return null;
    const mean = [x / n, y / n, z / n];
    const products = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]].map(([i, j]) => mean[i] * mean[j]);
    const direction = flatDirection(squares.map((sum, k) => sum / n - products[k]));
    if (!direction) return null;
    const place = add(low, scale(mean, step_m));
    let side = 0;
    for (const { place: eye, ahead } of seenFrom) {
      const way = sub(eye, place);
      const far = norm(way) || 1;
      if (!ahead || -dot(way, ahead) > IN_PICTURE * far) side += dot(direction, way) / far ** 3;
    }
    return side ? scale(direction, Math.sign(side)) : null;
  });
}

/** A cell without a direction, such as a corner, has that of its neighbours if they agree. */
function filled(directions, { places, side }) {
  const beside = [-1, 0, 1].flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((z) => (x * side + y) * side + z)));
  const found = [...directions];
  for (const [key, cell] of places) {
    if (directions[cell]) continue;
    const around = beside.map((by) => directions[places.get(key + by)]).filter(Boolean);
    if (!around.length) continue;
    const mean = scale(around.reduce(add), 1 / around.length);
    if (norm(mean) > AGREEING) found[cell] = unit(mean);
  }
  return found;
}

/**
 * The side of each point that was seen (3 n, 8 bit): a direction, or 0 where there is none and for points of objects.
 * `seenFrom`: positions `place` of the camera, and its axes `ahead` if they are known.
 */
function facingOf(points, seenFrom) {
  const facing = new Int8Array(3 * points.label.length);
  if (!seenFrom.length) return facing;
  const cells = cellsOf(points);
  const directions = filled(directionsOf(cells, seenFrom), cells);
  points.label.forEach((label, i) => {
    const direction = !label && directions[cells.of[i]];
    if (direction) facing.set(direction.map((value) => Math.round(127 * value)), 3 * i);
  });
  return facing;
}

/** Whether a point is cut for an eye: its seen side is turned away by more than the angle of this sine. */
const TURNED_AWAY = 0.08;
function isCut(facing, i, way) {
  const away = facing[3 * i] * way[0] + facing[3 * i + 1] * way[1] + facing[3 * i + 2] * way[2];
  return away < -TURNED_AWAY * 127 * Math.hypot(...way);
}
