// The page of a calibration follows it.
import { call, confirmed, tell } from './page.js';
import { follow } from './live.js';

const state = document.getElementById('state');
const isEnded = () => !state.querySelector('[data-state=queued], [data-state=running]');
if (!isEnded()) follow(state, 'state', () => { if (isEnded()) location.reload(); });

document.getElementById('cancel')?.addEventListener('click', async (event) => {
  const button = event.target;
  if (!await confirmed('Cancel this calibration?', 'Cancel it')) return;
  button.disabled = true;
  try {
    await call('POST', `${state.dataset.url}/cancel`);
  } catch (error) {
    button.disabled = false;
    tell('told', error.message);
  }
});
