// Draws points, lines, surfaces and marks in a canvas by WebGL 2, when something has changed. Colours are names of
// custom properties of the style sheet, so that both themes are right. Marks can be hovered, stepped through by
// keyboard and opened.
import { projected, scaled, add, unit } from './matrix.js';
import { Orbit } from './orbit.js';
import { programs } from './shaders.js';

const REACH_PX = 16;
const REST_MS = 250;
/** Points that are always drawn; of larger clouds a part while the camera moves, if the machine is slow. */
const LEAST_POINTS = 60000;
const SHAPES = { disc: 0, diamond: 1, cross: 2, ring: 3, dot: 4 };

/** True where the browser can draw in three dimensions. */
export const isAble = () => Boolean(document.createElement('canvas').getContext('webgl2'));

/** A scene in `canvas`. `selected` is called with a mark or null, `opened` with a mark. Throws without WebGL 2. */
export class Scene {
  constructor(canvas, { selected, opened } = {}) {
    Object.assign(this, { canvas, selected, opened });
    this.gl = canvas.getContext('webgl2', { alpha: false, antialias: true, depth: true });
    if (!this.gl) throw new Error('this browser has no WebGL 2');
    this.layers = new Map();
    this.labels = [];
    this.marks = [];
    this.colours = {};
    this.chosen = null;
    this.share = 0.25;
    this.isMoving = false;
    this.fading = 0;
    this.orbit = new Orbit(canvas, {
      changed: () => this.moved(),
      hovered: (at) => {
        const mark = at && this.hit(at);
        canvas.classList.toggle('over', Boolean(mark));
        // a mark that was chosen stays so until another one is
        if (mark) this.choose(mark);
      },
      clicked: (at, event) => this.clicked(at, event),
    });
    canvas.addEventListener('keydown', (event) => this.keydown(event));
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => { this.prepare(); this.draw(); });
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { this.colours = {}; this.draw(); });
    new ResizeObserver(() => this.draw()).observe(canvas);
    this.prepare();
  }

  /** Compiles the programs, and hands over what is to be drawn. */
  prepare() {
    const { gl } = this;
    this.programs = programs(gl);
    // what has no colours of its own is grey
    gl.vertexAttrib4f(1, 0.7, 0.7, 0.7, 1);
    this.markArray = this.buffered({ position: [null, 3], paint: [null, 4], look: [null, 2] });
    for (const layer of this.layers.values()) this.upload(layer);
  }

  /** A vertex array of attributes, which are pairs of data and components; bytes are colours from 0 to 255. */
  buffered(attributes, indices) {
    const { gl } = this;
    const array = { vao: gl.createVertexArray(), buffers: {} };
    gl.bindVertexArray(array.vao);
    for (const [place, name] of [['position'], ['paint'], ['place', 'look'], ['normal']].entries()) {
      const key = name.find((one) => attributes[one]?.[0] !== undefined);
      if (!key) continue;
      const [data, size] = attributes[key];
      array.buffers[key] = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, array.buffers[key]);
      if (data) gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      // marks come later, all as numbers
      const isBytes = data instanceof Uint8Array;
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, isBytes ? gl.UNSIGNED_BYTE : gl.FLOAT, isBytes, 0, 0);
    }
    if (indices) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    return array;
  }

  /** Adds or replaces what is drawn under a name. `kind`: `points` (positions, colours; `size` in the world), `lines`
   *  (positions, two per line; `colour`), or `mesh` (positions, indices; colours, normals, or places in `picture`). */
  set(name, layer) {
    this.remove(name);
    this.layers.set(name, { isShown: true, ...layer });
    this.upload(this.layers.get(name));
    this.draw();
  }

  remove(name) {
    const { array } = this.layers.get(name) ?? {};
    if (array) {
      Object.values(array.buffers).forEach((buffer) => this.gl.deleteBuffer(buffer));
      this.gl.deleteVertexArray(array.vao);
    }
    this.layers.delete(name);
  }

  show(name, isShown) {
    const layer = this.layers.get(name);
    if (layer) layer.isShown = isShown;
    this.draw();
  }

  upload(layer) {
    const { positions, colours, places, normals, indices, picture } = layer;
    layer.array = this.buffered({ position: [positions, 3], paint: [colours, 4], place: [places, 2], normal: [normals, 3] }, indices);
    if (picture) this.paintOn(layer, picture);
  }

  /** Gives a mesh a picture: a canvas or an image. */
  paintOn(layer, picture) {
    const { gl } = this;
    layer.picture = picture;
    layer.texture ??= gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, layer.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, axis, gl.CLAMP_TO_EDGE);
    this.draw();
  }

  /** Marks: `{ name, position, shape, colour, px, href }`. A chosen one stays chosen when its name is still there. */
  setMarks(marks) {
    this.marks = marks;
    this.choose(marks.find((mark) => mark.name === this.chosen?.name) ?? null);
    this.draw();
  }

  /** Words at places of the scene. They are for the eye alone. */
  setLabels(labels) {
    this.labels.forEach(({ element }) => element.remove());
    this.labels = labels.map(({ text, position }) => {
      const element = document.createElement('span');
      element.textContent = text;
      element.ariaHidden = 'true';
      this.canvas.parentElement.append(element);
      return { element, position };
    });
    this.draw();
  }

  /** The mark at a place of the canvas: of those within reach the nearest to the camera. */
  hit([x, y]) {
    const { clientWidth, clientHeight } = this.canvas;
    let [best, least] = [null, Infinity];
    for (const mark of this.marks) {
      const at = !mark.isHidden && this.matrix && projected(this.matrix, mark.position);
      const away = at ? Math.hypot(at[0] * clientWidth - x, at[1] * clientHeight - y) / REACH_PX : Infinity;
      if (away < 1 && away + 2 * this.far(at[2]) < least) [best, least] = [mark, away + 2 * this.far(at[2])];
    }
    return best;
  }

  /** Share of the way from the nearest to the farthest point of the scene. */
  far(depth) {
    const [near, far] = this.depths;
    return Math.max(0, Math.min(1, (depth - near) / (far - near)));
  }

  choose(mark) {
    if (mark === this.chosen) return;
    this.chosen = mark;
    this.selected?.(mark);
    this.draw();
  }

  clicked(at, event) {
    const mark = this.hit(at);
    // a finger has no hover: it chooses first, and opens what is chosen
    const isOpened = mark && (event.pointerType !== 'touch' || mark === this.chosen);
    this.choose(mark);
    if (isOpened) this.opened?.(mark);
  }

  keydown(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const shown = this.marks.filter((mark) => !mark.isHidden);
    const at = shown.indexOf(this.chosen);
    const step = (by) => this.choose(shown[(Math.max(at, by < 0 ? 0 : -1) + by + shown.length) % shown.length]);
    const act = {
      n: () => step(1),
      p: () => step(-1),
      Enter: () => this.opened?.(this.chosen),
      Escape: () => this.choose(null),
    }[event.key];
    if (!act || !shown.length || (event.key === 'Enter' && !this.chosen)) return;
    event.preventDefault();
    act();
  }

  moved() {
    this.isMoving = true;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => { this.isMoving = false; this.draw(); }, Math.max(REST_MS, 3 * (this.took ?? 0)));
    this.draw();
  }

  draw() {
    // one picture at a time: a slow machine must not have a queue of them
    this.isWanted = true;
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWanted = false;
      const began = performance.now();
      this.paint();
      if (this.isMoving) this.await(began); else this.isWaiting = false;
    });
  }

  /** Waits until a picture is there, and keeps the motion fluid: draws fewer points while pictures take long. */
  await(began) {
    const { gl } = this;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    const look = () => {
      if (sync && gl.clientWaitSync(sync, gl.SYNC_FLUSH_COMMANDS_BIT, 0) === gl.TIMEOUT_EXPIRED) { setTimeout(look, 3); return; }
      gl.deleteSync(sync);
      this.took = performance.now() - began;
      this.share = Math.max(0.01, Math.min(1, this.share * Math.max(0.3, Math.min(1.25, 30 / this.took))));
      this.isWaiting = false;
      if (this.isWanted) this.draw();
    };
    look();
  }

  /** A colour of the style sheet, from 0 to 1. */
  colour(name) {
    if (!this.colours[name]) {
      const brush = (this.brush ??= document.createElement('canvas').getContext('2d'));
      brush.fillStyle = getComputedStyle(this.canvas).getPropertyValue(name);
      this.colours[name] = [1, 3, 5].map((at) => parseInt(brush.fillStyle.slice(at, at + 2), 16) / 255);
    }
    return this.colours[name];
  }

  paint() {
    const { gl, canvas, orbit } = this;
    const { clientWidth, clientHeight } = canvas;
    if (!clientWidth || gl.isContextLost()) return;
    this.dense = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [clientWidth, clientHeight].map((side) => Math.round(side * this.dense));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.matrix = orbit.matrix(clientWidth / clientHeight);
    this.depths = [orbit.distance - orbit.home.radius, orbit.distance + orbit.home.radius];
    this.back = this.colour('--card');
    gl.viewport(0, 0, width, height);
    gl.clearColor(...this.back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    for (const layer of this.layers.values()) if (layer.isShown) this[layer.kind](layer);
    this.paintMarks();
    this.placeLabels();
  }

  use(kind) {
    const { gl } = this;
    const { program, places } = this.programs[kind];
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.u_matrix, false, this.matrix);
    if (places.u_fade) {
      gl.uniform4f(places.u_fade, ...this.back, this.fading);
      gl.uniform2f(places.u_depth, ...this.depths);
    }
    return places;
  }

  points({ array, positions, size }) {
    const { gl } = this;
    const places = this.use('points');
    const all = positions.length / 3;
    const count = this.isMoving ? Math.min(all, Math.max(LEAST_POINTS, Math.round(all * this.share))) : all;
    // fewer points are drawn larger
    gl.uniform1f(places.u_size, size * this.canvas.height * 1.6 * Math.sqrt(all / Math.max(1, count)));
    gl.bindVertexArray(array.vao);
    gl.drawArrays(gl.POINTS, 0, count);
  }

  lines({ array, positions, colour }) {
    const { gl } = this;
    gl.uniform3f(this.use('lines').u_colour, ...this.colour(colour));
    gl.bindVertexArray(array.vao);
    gl.drawArrays(gl.LINES, 0, positions.length / 3);
  }

  mesh({ array, indices, texture, stretch = [1, 1, 1] }) {
    const { gl } = this;
    const places = this.use('mesh');
    const [right, up, back] = this.orbit.axes;
    gl.uniform3f(places.u_light, ...unit(add(back, add(scaled(right, -0.5), scaled(up, 0.6)))));
    gl.uniform3f(places.u_eye, ...this.orbit.eye);
    gl.uniform3f(places.u_stretch, ...stretch);
    gl.uniform1i(places.u_textured, texture ? 1 : 0);
    if (texture) gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.bindVertexArray(array.vao);
    gl.drawElements(gl.TRIANGLES, indices.length, gl.UNSIGNED_INT, 0);
  }

  paintMarks() {
    const { gl, dense } = this;
    const shown = this.marks.filter((mark) => !mark.isHidden).map((mark) => [projected(this.matrix, mark.position)?.[2] ?? 0, mark]);
    if (!shown.length) return;
    shown.sort((a, b) => b[0] - a[0]);
    const data = { position: [], paint: [], look: [] };
    for (const [depth, mark] of shown) {
      const isChosen = mark === this.chosen;
      const px = mark.px * dense * (1 - 0.35 * this.fading * this.far(depth));
      const put = (colour, shape, size) => {
        data.position.push(...mark.position);
        data.paint.push(...this.colour(colour), 1);
        data.look.push(SHAPES[shape], size);
      };
      if (isChosen) put('--ink', 'ring', Math.max(px, 10 * dense) * 2);
      put(mark.colour, mark.shape, px * (isChosen ? 1.15 : 1));
    }
    this.use('marks');
    gl.bindVertexArray(this.markArray.vao);
    for (const [key, numbers] of Object.entries(data)) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.markArray.buffers[key]);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.DYNAMIC_DRAW);
    }
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
    gl.depthMask(false);
    gl.drawArrays(gl.POINTS, 0, data.look.length / 2);
    gl.depthMask(true);
  }

  placeLabels() {
    for (const { element, position } of this.labels) {
      const at = projected(this.matrix, position);
      const isInside = at && at[0] > 0.02 && at[0] < 0.98 && at[1] > 0.03 && at[1] < 0.97;
      element.hidden = !isInside;
      if (!isInside) continue;
      element.style.left = `${100 * at[0]}%`;
      element.style.top = `${100 * at[1]}%`;
      element.style.opacity = String(1 - 0.5 * this.far(at[2]));
    }
  }
}
