// The programs of the graphics processor, by the kind of what they draw.

// what is far is faded towards the background: u_fade is its colour and how much, u_depth nearest and farthest
const FADE = `
uniform vec4 u_fade; uniform vec2 u_depth;
vec3 faded(vec3 colour, float depth) {
  return mix(colour, u_fade.rgb, u_fade.a * clamp((depth - u_depth.x) / (u_depth.y - u_depth.x), 0.0, 1.0));
}`;

const HEAD = '#version 300 es\nprecision highp float;\nuniform mat4 u_matrix;\n';

const FLAT = `${HEAD}in vec3 v_colour; out vec4 colour; void main() { colour = vec4(v_colour, 1.0); }`;

// gl_PointCoord from -1 to 1; the distance to the edge of each shape in v_size pixels
const MARK = `${HEAD}in vec3 v_colour; in vec2 v_look; out vec4 colour;
void main() {
  vec2 p = abs(gl_PointCoord * 2.0 - 1.0);
  float r = length(p);
  int shape = int(v_look.x + 0.5);
  float inside = shape == 0 ? 0.8 - r : shape == 1 ? (0.95 - p.x - p.y) * 0.7 : shape == 2
    ? min(0.24 - abs(p.x - p.y) * 0.7, 0.8 - max(p.x, p.y)) : shape == 3 ? 0.17 - abs(r - 0.66) : 0.45 - r;
  float alpha = clamp(inside * v_look.y * 0.5 + 0.5, 0.0, 1.0);
  if (alpha < 0.05) discard;
  colour = vec4(v_colour, alpha);
}`;

const COLOURED = `layout(location = 0) in vec3 position; layout(location = 1) in vec4 paint; out vec3 v_colour;`;

/** Vertex and fragment shader of each kind. */
const SHADERS = {
  points: [`${HEAD}${COLOURED}${FADE} uniform float u_size;
void main() {
  gl_Position = u_matrix * vec4(position, 1.0);
  gl_PointSize = clamp(u_size / gl_Position.w, 1.0, 24.0);
  v_colour = faded(paint.rgb, gl_Position.w);
}`, FLAT],

  lines: [`${HEAD}layout(location = 0) in vec3 position; out vec3 v_colour;${FADE} uniform vec3 u_colour;
void main() { gl_Position = u_matrix * vec4(position, 1.0); v_colour = faded(u_colour, gl_Position.w); }`, FLAT],

  marks: [`${HEAD}${COLOURED}${FADE} layout(location = 2) in vec2 look; out vec2 v_look;
void main() {
  gl_Position = u_matrix * vec4(position, 1.0);
  // before the lines that meet in it
  gl_Position.z -= 0.003 * gl_Position.w;
  gl_PointSize = look.y;
  v_look = look;
  v_colour = faded(paint.rgb, gl_Position.w);
}`, MARK],

  // lit from the camera, a little from the left and above; u_stretch scales the positions
  mesh: [`${HEAD}${COLOURED} layout(location = 2) in vec2 place; layout(location = 3) in vec3 normal;
uniform vec3 u_stretch; out vec3 v_position; out vec2 v_place; out vec3 v_normal;
void main() {
  v_position = position * u_stretch; v_place = place; v_colour = paint.rgb; v_normal = normal;
  gl_Position = u_matrix * vec4(v_position, 1.0);
}`, `${HEAD}in vec3 v_position; in vec2 v_place; in vec3 v_colour; in vec3 v_normal; out vec4 colour;
uniform sampler2D u_texture; uniform bool u_textured; uniform vec3 u_light; uniform vec3 u_eye;
void main() {
  vec4 base = u_textured ? texture(u_texture, v_place) : vec4(v_colour, 1.0);
  if (base.a < 0.5) discard;
  vec3 n = dot(v_normal, v_normal) > 0.0 ? normalize(v_normal) : normalize(cross(dFdx(v_position), dFdy(v_position)));
  n = faceforward(n, v_position - u_eye, n);
  colour = vec4(base.rgb * (0.35 + 0.75 * max(dot(n, u_light), 0.0)), 1.0);
}`],
};

/** The compiled programs by kind, with the places of their uniforms. */
export function programs(gl) {
  const compiled = (kind, source) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    return shader;
  };
  return Object.fromEntries(Object.entries(SHADERS).map(([name, [vertex, fragment]]) => {
    const program = gl.createProgram();
    gl.attachShader(program, compiled(gl.VERTEX_SHADER, vertex));
    gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, fragment));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
    const places = {};
    for (let at = 0; at < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); at += 1) {
      const { name: uniform } = gl.getActiveUniform(program, at);
      places[uniform] = gl.getUniformLocation(program, uniform);
    }
    return [name, { program, places }];
  }));
}
