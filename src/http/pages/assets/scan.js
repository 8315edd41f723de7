// The page of a scan: its views as they are fused, its buttons, and the report on poses.
import { call, confirmed, element, json, link, tell } from './page.js';
import { follow } from './live.js';
import { ball } from './ball.js';

const box = document.getElementById('views');
const url = link(`/v1/scans/${encodeURIComponent(box.dataset.scan)}`);
const by = (id) => document.getElementById(id);
const turned = ball(box, { canvas: by('ball-canvas'), section: by('ball'), told: by('ball-told') });
follow(box, 'views', () => {
  by('lead').replaceChildren(...box.querySelectorAll(':scope > .lead, :scope > .warnings'));
  turned();
});

const reconstructions = by('reconstructions');
const isIdle = () => !reconstructions.querySelector('[data-state=queued], [data-state=running]');
let isFollowed = false;
function followReconstruction() {
  // the model of a new reconstruction comes with the page
  if (!isFollowed) follow(reconstructions, 'reconstructions', () => { if (isIdle()) location.reload(); });
  isFollowed = true;
}
if (!isIdle()) followReconstruction();

by('reconstruct')?.addEventListener('click', async () => {
  tell('reconstruct-told', '');
  try {
    const summary = await json('GET', url);
    await json('POST', `${url}/reconstructions`, { partial: summary.summary.views > summary.summary.succeeded });
    tell('reconstruct-told', 'The reconstruction waits for a worker.', true);
    followReconstruction();
  } catch (error) { tell('reconstruct-told', error.message); }
});

reconstructions.addEventListener('click', async (event) => {
  const button = event.target.closest('[data-cancel]');
  if (!button || !await confirmed('Cancel this reconstruction?', 'Cancel it')) return;
  button.disabled = true;
  try {
    await call('POST', `${button.dataset.cancel}/cancel`);
  } catch (error) {
    button.disabled = false;
    tell('reconstruct-told', error.message);
  }
});

by('rerun')?.addEventListener('click', async () => {
  if (!await confirmed('Fuse every view again with the current revision of the profile? The present results stay until they are replaced.', 'Fuse all again')) return;
  tell('told', '');
  try {
    const { views, skipped } = await json('POST', `${url}/rerun`, { profile_revision: null });
    const without = skipped.length ? `; ${skipped.length} have no zip any more` : '';
    tell('told', `${views.length} views are fused again${without}`, true);
  } catch (error) { tell('told', error.message); }
});

by('delete')?.addEventListener('click', async () => {
  if (!await confirmed('Delete this scan with all its stacks, their results and zips? This cannot be undone.', 'Delete everything')) return;
  tell('told', '');
  try {
    await call('DELETE', `${url}?stacks=delete`);
    location.assign(link('/scans'));
  } catch (error) { tell('told', error.message); }
});

by('poses').addEventListener('submit', async (event) => {
  event.preventDefault();
  const [file] = by('poses-file').files;
  const [report, save] = [by('poses-report'), by('poses-save')];
  tell('poses-told', '');
  report.hidden = save.hidden = true;
  const send = (format) => call('POST', `${url}/poses?format=${format}`, file, { 'content-type': 'application/octet-stream' });
  try {
    report.replaceChildren(element('pre', {}, await (await send('text')).text()));
    report.hidden = false;
    save.href = URL.createObjectURL(await (await send('html')).blob());
    save.hidden = false;
  } catch (error) { tell('poses-told', error.message); }
});
