// The page of a profile: gives it a camera.
import { json, tell } from './page.js';
import { followSensor, numbersOf } from './measures.js';

const NUMBERS = ['target_pitch_mm', 'pixel_pitch_mm', 'rail_step_mm', 'focal_mm', 'pupil_ratio', 'magnification'];
const form = document.getElementById('camera-form');
if (form) {
  followSensor(form, () => Number(form.dataset.width));
  form.addEventListener('submit', async (event) => {
    event.preventDefault();
    tell('told', '');
    try {
      const body = numbersOf(form, NUMBERS);
      if (form.elements.capture_mode.value) body.capture_mode = form.elements.capture_mode.value;
      await json('POST', form.dataset.url, body);
      location.reload();
    } catch (error) { tell('told', error.message); }
  });
}
