// Vectors are arrays of 3 numbers; matrices are Float32Array(16) in column-major order, as WebGL expects.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => scale(a, 1 / (norm(a) || 1));
const mix = (a, b, s) => a.map((value, i) => value + (b[i] - value) * s);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** A direction perpendicular to a unit vector: the longest of its cross products with the axes. */
function sideways(up) {
  const crosses = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => cross(axis, up));
  return unit(crosses.reduce((a, b) => (norm(b) > norm(a) ? b : a)));
}

function perspective(fovY, aspect, near, far) {
  const f = 1 / Math.tan(fovY / 2);
  const m = new Float32Array(16);
  m[0] = f / aspect;
  m[5] = f;
  m[10] = (far + near) / (near - far);
  m[11] = -1;
  m[14] = (2 * far * near) / (near - far);
  return m;
}

/** World to eye: x right, y up, looking along -z. */
function lookAt(eye, target, up) {
  const z = unit(sub(eye, target));
  const x = unit(cross(up, z));
  const y = cross(z, x);
  return new Float32Array([
    x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1,
  ]);
}

function multiply(a, b) {
  const m = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) m[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return m;
}

/** Clip coordinates (x, y, z, w) of a point. */
function toClip(m, p) {
  return [0, 1, 2, 3].map((row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row]);
}

/** Column k of a rotation given by rows. */
const axis = (rotation, k) => [rotation[0][k], rotation[1][k], rotation[2][k]];

/** The eight corners of a box; bit 0, 1, 2 of a corner's number is set for +x, +y, +z. */
function corners(box) {
  return [...Array(8).keys()].map((number) =>
    [0, 1, 2].reduce(
      (p, k) => add(p, scale(axis(box.rotation, k), (((number >> k) & 1) - 0.5) * box.size[k])),
      box.center,
    ),
  );
}

/** Distance along a ray at which it enters a box, or null (A. Kay and J. Kajiya, 1986: slabs). */
function enterBox(origin, direction, box) {
  let enter = 0;
  let leave = Infinity;
  const way = sub(box.center, origin);
  for (let k = 0; k < 3; k++) {
    const along = axis(box.rotation, k);
    const middle = dot(along, way);
    const speed = dot(along, direction) || 1e-12;
    const ends = [(middle - box.size[k] / 2) / speed, (middle + box.size[k] / 2) / speed];
    enter = Math.max(enter, Math.min(...ends));
    leave = Math.min(leave, Math.max(...ends));
  }
  return enter <= leave ? enter : null;
}
