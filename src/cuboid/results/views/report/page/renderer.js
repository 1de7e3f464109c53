// Draws points, lines and faces with WebGL 2; it is independent of objects and cameras.

function compile(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error([gl.getProgramInfoLog(program), ...logs].join(" "));
  }
  const at = {};
  for (let i = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) {
    const { name } = gl.getActiveUniform(program, i);
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}

class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("no WebGL 2");
    const gl = this.gl;
    this.programs = {
      points: compile(gl, POINTS_VERTEX, POINTS_FRAGMENT),
      shade: compile(gl, SHADE_VERTEX, SHADE_FRAGMENT),
      lines: compile(gl, LINES_VERTEX, LINES_FRAGMENT),
      faces: compile(gl, FACES_VERTEX, FACES_FRAGMENT),
    };
    this.empty = gl.createVertexArray();
    this.points = null;
    this.groups = new Map();
    this.inferno = this.texture(256, 1, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, bytesOf(data.inferno));
    this.target = null;
  }

  texture(width, height, kept, format, type, content) {
    const gl = this.gl;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, kept, width, height, 0, format, type, content);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    return texture;
  }

  /** Describe an attribute of the bound buffer. */
  attribute(program, name, size, type, normalized, stride, offset, divisor = 0) {
    const gl = this.gl;
    const place = gl.getAttribLocation(program, name);
    if (place < 0) return;
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalized, stride, offset);
    gl.vertexAttribDivisor(place, divisor);
  }

  /**
   * Set the point map, in place of the previous one. `own`: color (3 n, 8 bit) of the object of each point, 0 for
   * points without an object. `facing`: the side of each point that was seen, see facing.js.
   */
  setPoints({ steps, look }, own, facing) {
    const gl = this.gl;
    const { program } = this.programs.points;
    if (this.points) {
      this.points.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
      gl.deleteVertexArray(this.points.array);
    }
    const array = gl.createVertexArray();
    const buffers = [];
    gl.bindVertexArray(array);
    for (const [name, content, size, type, normalized] of [
      ["steps", steps, 3, gl.UNSIGNED_SHORT, false],
      ["look", look, 4, gl.UNSIGNED_BYTE, true],
      ["own", own, 3, gl.UNSIGNED_BYTE, true],
      ["facing", facing, 3, gl.BYTE, true],
    ]) {
      buffers.push(gl.createBuffer());
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[buffers.length - 1]);
      gl.bufferData(gl.ARRAY_BUFFER, content, gl.STATIC_DRAW);
      this.attribute(program, name, size, type, normalized, 0, 0);
    }
    gl.bindVertexArray(null);
    this.points = { array, buffers, count: steps.length / 3 };
  }

  /**
   * Set the segments of a group, each with from (3), to (3), color (4), width in pixels, length of a dash.
   * A halo makes colored lines visible on any background.
   */
  setLines(name, segments, haloed = false) {
    const layout = [["from", 3], ["to", 3], ["paint", 4], ["style", 2]];
    this.setGroup(name, "lines", segments.flat(2), layout, 1);
    this.groups.get(name).haloed = haloed;
  }

  /** Set the triangles of a group, each corner with place (3), color (4). */
  setFaces(name, triangleCorners) {
    this.setGroup(name, "faces", triangleCorners.flat(2), [["place", 3], ["paint", 4]], 0);
  }

  setGroup(name, kind, numbers, layout, divisor) {
    const gl = this.gl;
    const group = this.groups.get(name) || { kind, array: gl.createVertexArray(), buffer: gl.createBuffer() };
    const width = layout.reduce((sum, [, size]) => sum + size, 0);
    gl.bindVertexArray(group.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, group.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.DYNAMIC_DRAW);
    let offset = 0;
    for (const [attribute, size] of layout) {
      this.attribute(this.programs[kind].program, attribute, size, gl.FLOAT, false, 4 * width, 4 * offset, divisor);
      offset += size;
    }
    gl.bindVertexArray(null);
    group.count = numbers.length / width;
    this.groups.set(name, group);
  }

  /** Fit the drawing, and the render target of the points, to the physical pixels of the canvas. */
  fit() {
    const gl = this.gl;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.ratio = ratio;
    if (this.target && this.target.width === width && this.target.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    if (this.target) [this.target.color, this.target.depth].forEach((texture) => gl.deleteTexture(texture));
    const color = this.texture(width, height, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, null);
    const depth = this.texture(
      width, height, gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null,
    );
    const buffer = this.target ? this.target.buffer : gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, color, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depth, 0);
    this.target = { width, height, color, depth, buffer };
  }

  /** Draw shaded points, faces, and lines; lines are dim where they are hidden. `cut`: without what is seen from behind. */
  draw(eye, coloring, ground, shownGroups, cut) {
    const gl = this.gl;
    this.drawPoints(eye, coloring, cut);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.target.width, this.target.height);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
    gl.depthFunc(gl.ALWAYS);
    this.shade(eye, ground);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    const groups = shownGroups.map((name) => this.groups.get(name)).filter((group) => group && group.count);
    gl.depthFunc(gl.LEQUAL);
    for (const group of groups.filter(({ kind }) => kind === "faces")) this.drawFaces(eye, group);
    const lines = groups.filter(({ kind }) => kind === "lines");
    gl.depthFunc(gl.GREATER);
    for (const group of lines) this.drawLines(eye, group, 0.3, 0, [0, 0, 0, 0]);
    gl.depthFunc(gl.LEQUAL);
    for (const group of lines) if (group.haloed) this.drawLines(eye, group, 1, 2.4 * this.ratio, ground.halo);
    for (const group of lines) this.drawLines(eye, group, 1, 0, [0, 0, 0, 0]);
  }

  drawPoints(eye, coloring, cut) {
    const gl = this.gl;
    const { program, at } = this.programs.points;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.buffer);
    gl.viewport(0, 0, this.target.width, this.target.height);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.points) return;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.clip_world, false, eye.clip_world);
    gl.uniform3fv(at.low, data.points.low);
    gl.uniform3fv(at.eye, eye.place);
    gl.uniform1f(at.turned_away, cut ? TURNED_AWAY : 2); // no sine is 2: nothing is cut
    gl.uniform1f(at.step_m, data.points.step_m);
    gl.uniform1f(at.spacing_m, data.points.spacing_m);
    gl.uniform1f(at.focal_px, (0.5 * this.target.height) / Math.tan(eye.fovY / 2));
    gl.uniform1f(at.near, eye.near);
    gl.uniform1f(at.far, eye.far);
    gl.uniform1i(at.coloring, ["color", "heat", "label"].indexOf(coloring));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.inferno);
    gl.uniform1i(at.inferno, 0);
    gl.bindVertexArray(this.points.array);
    gl.drawArrays(gl.POINTS, 0, this.points.count);
  }

  shade(eye, ground) {
    const gl = this.gl;
    const { program, at } = this.programs.shade;
    gl.useProgram(program);
    [this.target.color, this.target.depth].forEach((texture, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.uniform1i(at.colors, 0);
    gl.uniform1i(at.depths, 1);
    gl.uniform1f(at.near, eye.near);
    gl.uniform1f(at.far, eye.far);
    gl.uniform1f(at.strength, 26);
    gl.uniform1f(at.radius_px, 1.6 * this.ratio);
    gl.uniform3fv(at.sky, ground.sky);
    gl.uniform3fv(at.ground, ground.floor);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  drawLines(eye, group, share, widerPx, instead) {
    const gl = this.gl;
    const { program, at } = this.programs.lines;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.clip_world, false, eye.clip_world);
    gl.uniform2f(at.size_px, this.target.width, this.target.height);
    gl.uniform1f(at.near, eye.near);
    gl.uniform1f(at.wider_px, widerPx);
    gl.uniform1f(at.share, share);
    gl.uniform4fv(at.instead, instead);
    gl.bindVertexArray(group.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, group.count);
  }

  drawFaces(eye, group) {
    const gl = this.gl;
    const { program, at } = this.programs.faces;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.clip_world, false, eye.clip_world);
    gl.bindVertexArray(group.array);
    gl.drawArrays(gl.TRIANGLES, 0, group.count);
  }
}
