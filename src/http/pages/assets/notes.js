// The notes on the page of a stack, a scan or a profile: adds and deletes them.
import { call, confirmed, json, tell } from './page.js';

const section = document.getElementById('notes');
const { url } = section.dataset;

/** Runs the request, then shows the page with what it changed. */
async function change(control, request) {
  tell('notes-told', '');
  control.disabled = true;
  try {
    await request();
    location.reload();
  } catch (error) {
    control.disabled = false;
    tell('notes-told', error.message);
  }
}

section.querySelector('form')?.addEventListener('submit', (event) => {
  event.preventDefault();
  const form = event.target;
  change(event.submitter, () => json('POST', url, { text: form.elements.note.value }).then(() => form.reset()));
});

for (const button of section.querySelectorAll('[data-note]')) {
  button.addEventListener('click', async () => {
    if (await confirmed('Delete this note?', 'Delete')) change(button, () => call('DELETE', `${url}/${button.dataset.note}`));
  });
}
