// The numbers of a camera in a form: their values, the pixel pitch that follows from the width of the sensor, and what
// the EXIF of the chosen pictures offers.
import { element } from './page.js';

/** The values of these fields as numbers; empty and hidden ones are left out. Throws an Error that names a field. */
export function numbersOf(form, names) {
  const values = {};
  for (const name of names) {
    const input = form.elements[name];
    const text = !input || input.closest('[hidden]') ? '' : input.value.trim();
    if (!text) continue;
    values[name] = Number(text.replace(',', '.'));
    if (Number.isNaN(values[name])) throw new Error(`${form.querySelector(`label[for=${name}]`).textContent}: “${text}” is not a number`);
  }
  return values;
}

/** Keeps the pixel pitch that of the width of the sensor. `pixels` returns the longer side of the pictures, or 0. */
export function followSensor(form, pixels) {
  const { sensor_width_mm: width, pixel_pitch_mm: pitch } = form.elements;
  const follow = () => {
    const mm = Number(width.value.trim().replace(',', '.'));
    if (mm > 0 && pixels() > 0) pitch.value = String(Number((mm / pixels()).toPrecision(5)));
  };
  width.addEventListener('input', follow);
  return follow;
}

/** Offers the values of `head` beside their fields; a click takes one. */
export function offer(form, head) {
  for (const old of form.querySelectorAll('.offer')) old.remove();
  for (const [name, value, unit] of [['focal_mm', head?.focalMm, 'mm'], ['pixel_pitch_mm', head?.pitchMm, 'mm']]) {
    const input = form.elements[name];
    if (!value || !input) continue;
    const text = String(Number(value.toPrecision(5)));
    const button = element('button', { type: 'button', class: 'offer' }, `EXIF: ${text} ${unit}, use it`);
    button.addEventListener('click', () => { input.value = text; input.focus(); });
    input.after(button);
  }
}
