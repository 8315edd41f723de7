// The controls of the viewer: which pictures are at the left and at the right of the divider, and which slice of them.
import { Viewer } from './viewer.js';

/** Steps through slices as fast as they come: while one is on its way, only the last of those wanted meanwhile is kept. */
export class Stepper {
  constructor(show) { Object.assign(this, { show, wanted: null, asked: null, isBusy: false }); }

  /** Wants slice `number`. */
  want(number) {
    this.wanted = number;
    if (!this.isBusy) this.ask();
  }

  /** What was asked for is there, or will not come. */
  came() {
    this.isBusy = false;
    if (this.wanted !== this.asked) this.ask();
  }

  ask() {
    this.asked = this.wanted;
    this.isBusy = this.asked !== null;
    if (this.isBusy) this.show(this.asked);
  }
}

/** The picture of slice `number` of a layer of slices. */
export const slice = ({ tiles, ...layer }, number) => ({ ...layer, tiles: `${tiles}${number}` });

/** The controls of one side: a list of pictures, and a slider where slices are chosen. */
class Side {
  constructor(viewer, layers, side, id) {
    const by = (end) => document.getElementById(`${id}${end}`);
    Object.assign(this, { viewer, layers, side });
    [this.list, this.row, this.slider, this.told, this.named] = ['', '-slices', '-slice', '-told', '-named'].map(by);
    this.list.addEventListener('input', () => this.choose());
    this.slider.addEventListener('input', () => this.stepper?.want(Number(this.slider.value)));
    this.choose();
  }

  get layer() { return this.list.value === '' ? null : this.layers[this.list.value]; }

  choose() {
    const { layer } = this;
    const [last, before] = [(layer?.slices ?? 0) - 1, this.slider.value];
    this.row.hidden = last < 0;
    this.stepper = null;
    if (last < 0) {
      this.viewer.show(this.side, layer);
      this.name(layer?.name ?? '');
      return;
    }
    this.slider.max = last;
    this.slider.value = Math.min(before, last);
    let stays = false;
    this.stepper = new Stepper((number) => {
      this.viewer.show(this.side, slice(layer, number), stays);
      stays = true;
      this.told.textContent = `${number} of 0 to ${last}`;
      this.name(`Slice ${number} of 0 to ${last}${layer.name.slice(layer.name.indexOf(','))}`);
    });
    this.stepper.want(Number(this.slider.value));
  }

  /** Goes `by` slices on; false where no slices are shown. */
  step(by) {
    if (!this.stepper) return false;
    this.slider.value = Number(this.slider.value) + by;
    this.stepper.want(Number(this.slider.value));
    return true;
  }

  name(text) { this.named.textContent = text; }
}

/** A viewer in `canvas` with its controls. It tells size and scale in `readout`. */
export function controls(canvas, { tile, layers }, readout) {
  const [divider, behind] = ['divider', 'behind'].map((id) => document.getElementById(id));
  const sides = [];
  const viewer = new Viewer(canvas, {
    tile,
    first: layers[0],
    moved(scale, states) {
      const { width, height } = viewer.first;
      const percent = 100 * scale;
      const shown = `${width} × ${height} px, shown at ${percent < 10 ? percent.toFixed(1) : Math.round(percent)} %`;
      const state = ['failed', 'loading'].find((one) => states.includes(one));
      const more = { loading: ' · loading …', failed: ' · a part cannot be loaded: reload the page to try again' }[state];
      readout.textContent = shown + (more ?? '');
      sides.forEach((side, at) => { if (states[at] !== 'loading') side.stepper?.came(); });
    },
  });
  sides.push(new Side(viewer, layers, 0, 'layer'), new Side(viewer, layers, 1, 'other'));
  const divide = () => {
    viewer.divider = divider.value / 100;
    divider.setAttribute('aria-valuetext', `${Math.round(divider.value)} % from the left`);
    divider.hidden = !viewer.second;
    // each name stays on its side
    sides.forEach(({ named }, at) => {
      named.hidden = !viewer.second;
      named.style.maxWidth = `calc(${at ? 100 - divider.value : divider.value}% - .8rem)`;
    });
    viewer.behind = behind.value;
    viewer.draw();
  };
  for (const control of [sides[1].list, divider, behind]) control.addEventListener('input', divide);
  divider.addEventListener('wheel', (event) => viewer.wheel(event), { passive: false });
  canvas.addEventListener('keydown', (event) => {
    const by = { ',': -1, '.': 1 }[event.key];
    if (!by || event.ctrlKey || event.metaKey || event.altKey) return;
    if (sides.some((side) => side.step(by))) event.preventDefault();
  });
  const by = (id, act) => document.getElementById(id).addEventListener('click', act);
  by('fit', () => viewer.fit());
  by('full', () => viewer.full());
  by('closer', () => viewer.zoom(1.5));
  by('farther', () => viewer.zoom(1 / 1.5));
  divide();
  return viewer;
}
