// The four programs, in GLSL ES 3.00.

const POINTS_VERTEX = `#version 300 es
in vec3 steps;
in vec4 look;
in vec3 own;
in vec3 facing;
uniform mat4 clip_world;
uniform vec3 low, eye;
uniform float step_m, spacing_m, focal_px;
uniform float turned_away;
uniform int coloring;
uniform sampler2D inferno;
out vec3 tint;
out float away_m, radius_m;
void main() {
  vec3 place = low + steps * step_m;
  gl_Position = clip_world * vec4(place, 1.0);
  // a surface seen from behind is outside of the view
  if (dot(facing, normalize(eye - place)) < -turned_away) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  // a disc that touches its neighbours: no holes at short distance, no blots at long distance
  gl_PointSize = clamp(1.9 * spacing_m * focal_px / gl_Position.w, 2.0, 60.0);
  away_m = gl_Position.w;
  radius_m = 0.5 * gl_PointSize * away_m / focal_px;
  float grey = dot(look.rgb, vec3(0.299, 0.587, 0.114));
  if (coloring == 0) tint = look.rgb;
  else if (coloring == 1) tint = mix(vec3(grey * 0.55), texture(inferno, vec2(look.a, 0.5)).rgb, 0.85 * smoothstep(0.02, 0.35, look.a));
  else tint = own == vec3(0.0) ? vec3(grey * 0.5 + 0.1) : own * (0.35 + 0.75 * grey);
}`;

// The depth of a disc increases from its centre to its rim, so that each pixel of overlapping discs belongs to the
// nearest point (M. Schuetz and M. Wimmer, 2015).
const POINTS_FRAGMENT = `#version 300 es
precision highp float;
in vec3 tint;
in float away_m, radius_m;
uniform float near, far;
out vec4 color;
void main() {
  vec2 p = 2.0 * gl_PointCoord - 1.0;
  float out_of_middle = dot(p, p);
  if (out_of_middle > 1.0) discard;
  float distance_m = away_m + radius_m * out_of_middle;
  gl_FragDepth = far * (distance_m - near) / (distance_m * (far - near));
  color = vec4(tint, 1.0);
}`;

// One triangle covers the whole screen.
const SHADE_VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1), 0.0, 1.0);
}`;

// Eye-dome lighting (C. Boucheny, 2009): a pixel behind its neighbours on the screen is darker, so that shape is
// visible without normals. A background pixel with points on all sides is a gap between them: it gets the color of
// the farthest of them.
const SHADE_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D colors;
uniform highp sampler2D depths;
uniform float near, far, strength, radius_px;
uniform vec3 sky, ground;
out vec4 color;
float distance_of(float depth) {
  return near * far / (far - depth * (far - near));
}
ivec2 beside(ivec2 at, ivec2 by) {
  return clamp(at + by, ivec2(0), textureSize(depths, 0) - 1);
}
ivec2 over_gap(ivec2 at, int reach) {
  ivec2 best = at;
  float farthest = 0.0;
  for (int side = 0; side < 4; side++) {
    ivec2 way = side < 2 ? ivec2(2 * side - 1, 0) : ivec2(0, 2 * side - 5), met = at;
    for (int step = 1; step <= reach && met == at; step++)
      if (texelFetch(depths, beside(at, way * step), 0).r < 1.0) met = beside(at, way * step);
    if (met == at) return at;
    float depth = texelFetch(depths, met, 0).r;
    if (depth > farthest) {
      farthest = depth;
      best = met;
    }
  }
  return best;
}
void main() {
  ivec2 size = textureSize(depths, 0), at = ivec2(gl_FragCoord.xy);
  if (texelFetch(depths, at, 0).r == 1.0) at = over_gap(at, int(3.0 * radius_px));
  float depth = texelFetch(depths, at, 0).r;
  gl_FragDepth = depth;
  if (depth == 1.0) {
    color = vec4(mix(ground, sky, gl_FragCoord.y / float(size.y)), 1.0);
    return;
  }
  float own = log2(distance_of(depth)), sum = 0.0;
  for (int k = 0; k < 8; k++) {
    float turn = 0.7853982 * float(k);
    float other = texelFetch(depths, beside(at, ivec2(round(radius_px * vec2(cos(turn), sin(turn))))), 0).r;
    if (other < 1.0) sum += clamp(own - log2(distance_of(other)) - 0.004, 0.0, 0.06);
  }
  color = vec4(texelFetch(colors, at, 0).rgb * exp(-strength * sum / 8.0), 1.0);
}`;

// A segment is drawn as a rectangle on the screen, with a width in pixels.
const LINES_VERTEX = `#version 300 es
in vec3 from, to;
in vec4 paint;
in vec2 style;
uniform mat4 clip_world;
uniform vec2 size_px;
uniform float wider_px, near;
out vec4 tint;
out float along_m, dash;
void main() {
  float side = gl_VertexID % 2 == 0 ? -1.0 : 1.0;
  bool first = gl_VertexID < 2;
  vec4 a = clip_world * vec4(from, 1.0), b = clip_world * vec4(to, 1.0);
  if (a.w < near && b.w >= near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  else if (b.w < near && a.w >= near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 way = (b.xy / b.w - a.xy / a.w) * size_px;
  way = length(way) < 1e-4 ? vec2(1.0, 0.0) : normalize(way);
  float half_px = 0.5 * (style.x + wider_px);
  gl_Position = first ? a : b;
  // close the corners of a box: both ends are extended by half the width
  vec2 shift = vec2(-way.y, way.x) * side * half_px + way * (first ? -half_px : half_px);
  gl_Position.xy += shift * 2.0 / size_px * gl_Position.w;
  gl_Position.z -= 0.0012 * gl_Position.w;  // in front of the surface on which it lies
  tint = paint;
  along_m = first ? 0.0 : distance(from, to);
  dash = style.y;
}`;

const LINES_FRAGMENT = `#version 300 es
precision highp float;
in vec4 tint;
in float along_m, dash;
uniform vec4 instead;
uniform float share;
out vec4 color;
void main() {
  if (dash > 0.0 && fract(along_m / dash) > 0.55) discard;
  color = instead.a > 0.0 ? vec4(instead.rgb, instead.a * tint.a * share) : vec4(tint.rgb, tint.a * share);
}`;

const FACES_VERTEX = `#version 300 es
in vec3 place;
in vec4 paint;
uniform mat4 clip_world;
out vec4 tint;
void main() {
  gl_Position = clip_world * vec4(place, 1.0);
  gl_Position.z -= 0.0004 * gl_Position.w;
  tint = paint;
}`;

const FACES_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 tint;
out vec4 color;
void main() {
  color = tint;
}`;
