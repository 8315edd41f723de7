// The page of one stack: its viewer, its progress, and its buttons.
import { call, confirmed, element, json, link, tell } from './page.js';
import { controls } from './compare.js';
import { follow } from './live.js';
import { measure } from './measure.js';

const state = document.getElementById('state');
const url = link(`/v1/stacks/${state.dataset.stack}`);
const by = (id) => document.getElementById(id);

function isEnded() {
  return !state.querySelector('[data-state=queued], [data-state=running]');
}
if (!isEnded()) follow(state, 'state', () => { if (isEnded()) location.reload(); });

async function act(button, work) {
  tell('told', '');
  button.disabled = true;
  try {
    await work();
  } catch (error) {
    button.disabled = false;
    tell('told', error.message);
  }
}

by('cancel')?.addEventListener('click', async () => {
  if (!await confirmed('Cancel this stack? What was computed so far is lost. The zip stays.', 'Cancel the stack')) return;
  await act(by('cancel'), () => call('POST', `${url}/cancel`));
});

by('delete')?.addEventListener('click', async () => {
  if (!await confirmed('Delete this stack, its results and the zip that was sent? This cannot be undone.', 'Delete')) return;
  await act(by('delete'), async () => {
    await call('DELETE', url);
    location.assign(link('/stacks'));
  });
});

by('rerun')?.addEventListener('submit', async (event) => {
  event.preventDefault();
  const options = {};
  for (const [name, text] of new FormData(event.target)) {
    const value = text.trim();
    if (value) options[name] = name === 'profile_revision' ? Number(value) : value;
  }
  const button = event.target.querySelector('button');
  button.disabled = true;
  try {
    const made = await json('POST', `${url}/rerun`, options);
    location.assign(link(`/stacks/${made.id}`));
  } catch (error) {
    button.disabled = false;
    tell('rerun-told', error.message);
  }
});

const canvas = by('viewer');
if (canvas) {
  const scene = JSON.parse(canvas.dataset.scene);
  const readout = by('readout');
  const viewer = controls(canvas, scene, readout);
  const heights = by('relief-canvas')?.dataset.relief;
  measure(viewer, {
    spec: heights ? JSON.parse(heights) : null,
    mmPerPx: Number(canvas.dataset.mmPerPx) || null,
    tools: by('fit').parentElement,
    told: readout.parentElement.insertBefore(element('p', { class: 'readout', id: 'values', role: 'status' }), readout.nextSibling),
  });
  const opener = by('relief');
  if (opener && by('relief-place') && document.createElement('canvas').getContext('webgl2')) opener.hidden = false;
  let shown;
  const stretch = () => {
    by('stretch-told').textContent = Number(by('stretch').value).toFixed(1);
    shown.stretch(Number(by('stretch').value));
  };
  const colour = () => shown.colour(by('relief-colour').value).catch(() => { by('relief-told').textContent = 'The picture cannot be loaded: reload the page to try again.'; });
  opener?.addEventListener('click', async () => {
    const isOpen = by('relief-place').hidden;
    by('relief-place').hidden = !isOpen;
    opener.setAttribute('aria-expanded', String(isOpen));
    if (!isOpen || shown) return;
    by('relief-told').textContent = 'Loading the heights …';
    try {
      // only who opens it loads it
      const { relief } = await import('./relief.js');
      shown = await relief(by('relief-canvas'), scene, by('relief-told'));
    } catch (error) {
      by('relief-told').textContent = `${error.message[0].toUpperCase()}${error.message.slice(1)}.`;
      return;
    }
    stretch();
    by('stretch').addEventListener('input', stretch);
    by('relief-colour').addEventListener('input', colour);
    await colour();
  });
}
