// Shows the plan of what was chosen: what it is, what does not fit, its views, and the slices of one of them with
// pictures of the first, the middle and the last.
import { bytes, element } from './page.js';

const WIDTH = 220;
/** Views of the table: a page with more is slow, and nobody reads it. */
const ROWS = 300;
const WORDS = { bad: 'Does not fit', warn: 'Look at it', note: 'Note' };

const angle = (degrees) => (degrees === null ? '' : String(Number(degrees.toFixed(3))));
const base = (path) => path.split('/').pop();

function findingsOf(findings) {
  const item = ({ level, text, cure }) => element('li', { class: level }, element('strong', {}, `${WORDS[level]}: `),
    /[.!?]$/.test(text) ? `${text} ` : `${text}. `, cure);
  return element('ul', { class: 'findings' }, ...findings.map(item));
}

function tableOf(views, choose) {
  const counts = ({ front, back }) => `${front.length}/${back.length}`;
  const usual = views.map(counts).sort().at(views.length >> 1);
  const row = (view, at) => {
    const remark = view.problem ?? (counts(view) === usual ? view.gaps && `gap: ${view.gaps}` : 'differs from the others');
    const name = element('button', { type: 'button', class: 'quiet', title: 'Show its slices' }, view.name || '(no folder)');
    name.addEventListener('click', () => choose(at));
    return element('tr', {}, element('td', { class: 'l' }, name), element('td', {}, angle(view.pan_deg)), element('td', {}, angle(view.tilt_deg)),
      element('td', {}, String(view.front.length)), element('td', {}, String(view.back.length)), element('td', { class: 'l warn' }, remark ? `! ${remark}` : ''));
  };
  const head = ['View', 'Pan', 'Tilt', 'Front light', 'Back light', 'Remarks'].map((name, at) => element('th', { scope: 'col', class: at % 5 ? undefined : 'l' }, name));
  const more = views.length > ROWS ? ` The first ${ROWS} are shown.` : '';
  return element('div', { class: 'wide views', tabindex: '0', role: 'region', 'aria-label': 'Views' }, element('table', {},
    element('caption', { class: 'soft small' }, `${views.length} ${views.length === 1 ? 'view' : 'views'}, as the server reads the names. Nothing has been sent yet.${more}`),
    element('thead', {}, element('tr', {}, ...head)), element('tbody', {}, ...views.slice(0, ROWS).map(row))));
}

/** A small picture of a slice, or why there is none. */
async function picture(place, file) {
  if (/\.tiff?$/i.test(file.path)) { place.textContent = 'a TIFF has no preview in a browser'; return; }
  try {
    const bitmap = await createImageBitmap(await file.blob(), { resizeWidth: WIDTH, resizeQuality: 'medium' });
    const canvas = element('canvas', { width: bitmap.width, height: bitmap.height, role: 'img', 'aria-label': base(file.path) });
    canvas.getContext('2d').drawImage(bitmap, 0, 0);
    bitmap.close();
    place.replaceChildren(canvas);
  } catch { place.textContent = 'no preview: the browser cannot read it'; }
}

function slicesOf(view, files) {
  const names = view.front;
  const places = [...new Map([[0, 'First slice'], [names.length >> 1, 'Middle slice'], [names.length - 1, 'Last slice']].filter(([at]) => at >= 0 && names[at]))];
  const shown = places.map(([at, words]) => {
    const place = element('div', { class: 'pic' }, '…');
    const file = files.get(names[at]);
    if (file) picture(place, file);
    return element('figure', {}, place, element('figcaption', {}, words, element('small', {}, base(names[at]))));
  });
  const lights = [['Front light', names], ['Back light', view.back], ...(view.lights ?? []).map(({ name, slices }) => [name, slices]), ['Moved target', view.moved ?? []]];
  const list = ([words, all]) => element('div', {}, element('h3', {}, `${words}, ${all.length}`), element('ol', {}, ...all.map((name) => element('li', {}, base(name)))));
  const order = element('details', {}, element('summary', {}, 'Slices in the order of fusion'));
  order.addEventListener('toggle', () => {
    if (order.open && !order.querySelector('ol')) order.append(element('div', { class: 'columns' }, ...lights.filter(([, all]) => all.length).map(list)));
  });
  return [element('h2', {}, view.name ? `View ${view.name}` : 'Slices'), element('div', { class: 'thirds' }, ...shown), order];
}

/** What the heads say of the camera, in a few words. */
function cameraOf(heads) {
  const head = [...heads.values()].find(Boolean);
  if (!head) return '';
  const { make = '', model = '', lens, focalMm, taken, width, height } = head;
  const camera = model.startsWith(make) ? model : `${make} ${model}`;
  return [camera.trim(), lens, focalMm && `${Number(focalMm.toFixed(1))} mm`, `${width} × ${height} px`, taken?.replace(/^(\d+):(\d+):/, '$1-$2-')].filter(Boolean).join(' · ');
}

/** Draws the plan into a place. What did not change stays: the pictures of the slices, and where the focus is. */
export class Preview {
  constructor(place) {
    this.place = place;
    this.said = element('div');
    this.views = element('div');
    this.slices = element('div', { class: 'slices' });
    place.append(this.said, this.views, this.slices);
  }

  clear() {
    for (const part of [this.said, this.views, this.slices]) part.replaceChildren();
    this.drawn = null;
  }

  show({ title, views, findings }, { files, heads, purpose, zip }) {
    const size = [...files.values()].reduce((sum, file) => sum + file.size, 0);
    const what = zip ? `${zip.name}, ${bytes(zip.size)}` : `${files.size} pictures, ${bytes(size)}`;
    this.said.replaceChildren(element('p', { class: 'lead' }, element('strong', {}, title)), element('p', { class: 'soft' }, `${what}. Nothing has been sent yet. `, cameraOf(heads)),
      findings.length ? findingsOf(findings) : element('p', { class: 'told ok' }, 'Nothing was found that does not fit.'));
    const drawn = JSON.stringify([purpose, views]);
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    const choose = (at) => { this.slices.replaceChildren(...slicesOf(views[at], files)); };
    this.views.replaceChildren(...(purpose === 'scan' || views.length > 1 ? [tableOf(views, choose)] : []));
    if (views[0]?.front.length) choose(0); else this.slices.replaceChildren();
  }
}
