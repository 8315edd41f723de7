// Vectors of three numbers and matrices of four columns, as WebGL takes them (column after column).

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scaled = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));

/** Perspective projection; `angle` is the vertical field of view, radians. */
export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  const depth = 1 / (near - far);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + far) * depth, -1, 0, 0, 2 * near * far * depth, 0]);
}

/** World to camera: rows `right`, `up`, `back` of a camera at `eye`. */
export function looking([right, up, back], eye) {
  return new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ]);
}

/** The product `a b`: first `b`, then `a`. */
export function product(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) {
      for (let k = 0; k < 4; k += 1) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return out;
}

/** Where a point is: x and y from 0 at the left and the top to 1, and its depth; null behind the camera. */
export function projected(matrix, [x, y, z]) {
  const row = (at) => matrix[at] * x + matrix[at + 4] * y + matrix[at + 8] * z + matrix[at + 12];
  const depth = row(3);
  return depth > 0 ? [0.5 + row(0) / depth / 2, 0.5 - row(1) / depth / 2, depth] : null;
}

/** A rotation, as a function of vectors, after which `up` points along z. */
export function upright(up) {
  const z = unit(up);
  const x = unit(cross(Math.abs(z[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], z));
  const y = cross(z, x);
  return (vector) => [dot(x, vector), dot(y, vector), dot(z, vector)];
}
