// The scene of the latest moment, and the eye that keeps the cameras in view.

// To keep the cameras in view, the eye moves away to at most this multiple of the best distance for the objects.
const FARTHEST = 2;

const poseFrom = (m) => ({
  place: [m[3], m[7], m[11]],
  right: [m[0], m[4], m[8]],
  down: [m[1], m[5], m[9]],
  ahead: [m[2], m[6], m[10]],
});

const PICTURE_VERTEX = `#version 300 es
in vec3 place;
uniform mat4 clip_world;
out vec2 at;
void main() {
  gl_Position = clip_world * vec4(place, 1.0);
  at = vec2(gl_VertexID == 1 || gl_VertexID == 2 ? 1.0 : 0.0, gl_VertexID < 2 ? 0.0 : 1.0);
}`;

const PICTURE_FRAGMENT = `#version 300 es
precision mediump float;
in vec2 at;
uniform sampler2D picture;
out vec4 color;
void main() {
  color = vec4(texture(picture, at).rgb, 0.93);
}`;

const placeIn = (path, i) => Array.from(path.subarray(3 * i, 3 * i + 3));

/** The picture of a camera, at its image plane in the world. */
class Screen {
  constructor(gl, made) {
    this.gl = gl;
    this.made = made;
    this.array = gl.createVertexArray();
    this.buffer = gl.createBuffer();
    this.texture = gl.createTexture();
    this.ready = false;
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    const place = gl.getAttribLocation(this.made.program, "place");
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    gl.bindVertexArray(null);
  }

  show(picture, corners) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, picture);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners.flat()), gl.DYNAMIC_DRAW);
    this.ready = true;
  }

  draw(eye) {
    const gl = this.gl;
    if (!this.ready) return;
    gl.useProgram(this.made.program);
    gl.uniformMatrix4fv(this.made.at.clip_world, false, eye.clip_world);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.uniform1i(this.made.at.picture, 0);
    gl.bindVertexArray(this.array);
    gl.drawArrays(gl.TRIANGLE_FAN, 0, 4);
  }
}

/** The scene at the latest moment. */
class LiveScene extends Scene {
  constructor(renderer, state) {
    super(renderer, state);
    this.made = compile(renderer.gl, PICTURE_VERTEX, PICTURE_FRAGMENT);
    this.cameras = [];
  }

  stateOf(object) {
    if (!isWanted(this.state, object)) return "unknown";
    return object.seen ? "seen" : "hidden";
  }

  /** Show a moment and the pictures of its cameras. */
  take(moment, pictures) {
    this.size = pyramidSize();
    this.cameras = moment.cameras.map(({ lens, pose, path }, k) => ({
      lens,
      pose: poseFrom(pose),
      path: new Float32Array(bytesOf(path).buffer),
      screen: this.cameras[k]?.screen || new Screen(this.renderer.gl, this.made),
    }));
    this.cameras.forEach((camera, k) => camera.screen.show(pictures[k], this.cornersOf(camera)));
    this.boxes = new Map(data.objects.map((object) => [object.label, corners(object)]));
    this.update();
  }

  /** The camera through which the eye looks: the chosen one, else the first. */
  get camera() {
    return this.cameras[this.state.camera ?? 0];
  }

  /** The corners of the pyramids of the cameras. */
  cameraCorners() {
    return this.cameras.flatMap((camera) => [camera.pose.place, ...this.cornersOf(camera)]);
  }

  cornersOf({ pose, lens }) {
    return imageCorners(pose, this.depth(), lens);
  }

  seenFrom() {
    return this.cameras.flatMap((camera) => someOf(camera.path.length / 3, (i) => ({ place: placeIn(camera.path, i) })));
  }

  takeMap(points) {
    this.setPoints(points);
  }

  depth() {
    return 2.6 * this.size;
  }

  pathLines(ground, ratio) {
    const lines = super.pathLines(ground, ratio);
    for (const { path, pose } of this.cameras) {
      const count = path.length / 3;
      for (let i = 1; i <= count; i++) {
        const to = i < count ? placeIn(path, i) : pose.place;
        lines.push([placeIn(path, i - 1), to, colorOf(ground.path, 0.25 + 0.6 * (i / count)), [1.6 * ratio, 0]]);
      }
    }
    return lines;
  }

  cameraLines(ground, ratio) {
    const color = colorOf(ground.path, 1);
    return this.cameras.flatMap(({ pose, lens }) => pyramidLines(pose, this.depth(), color, 2 * ratio, lens));
  }

  cameraFaces() {
    return [];
  }

  draw(eye) {
    super.draw(eye);
    if (this.state.layers.camera && !this.state.follow) for (const { screen } of this.cameras) screen.draw(eye);
  }
}

/** An eye that keeps objects and cameras in view until the user chooses another point of view. */
class LiveOrbit extends Orbit {
  constructor(canvas, changed, grabbed) {
    super(canvas, changed, grabbed);
    this.cameras = [];
    this.arrives = 0;
  }

  /** Set the points that must be in view: positions of the cameras and corners of their pictures. */
  take(places) {
    this.cameras = places;
    this.span = this.spanOfScene();
  }

  home() {
    const place = super.home();
    const nearest = place.distance;
    while (!this.holds(place, 0.86) && place.distance < FARTHEST * nearest) place.distance *= 1.06;
    return place;
  }

  /** Whether the cameras are visible from a point of view, within this fraction of the view's width and height. */
  holds(place, share) {
    const before = this.place;
    this.place = place;
    const { clip_world } = this.eye();
    this.place = before;
    return (this.cameras || []).every((point) => {
      const [x, y, , w] = toClip(clip_world, point);
      return w > 0 && Math.abs(x) < share * w && Math.abs(y) < share * w;
    });
  }

  fly(place, milliseconds = 500) {
    this.arrives = performance.now() + milliseconds;
    super.fly(place, milliseconds);
  }

  get isFlying() {
    return performance.now() < this.arrives;
  }

  get losesCameras() {
    return !this.holds(this.place, 1);
  }
}
