// The buttons of findings: each sends the request of the API that the finding names.
import { call, confirmed, json, link, tell } from './page.js';

async function act(button) {
  tell('advice-told', '');
  const { href, options } = button.dataset;
  const isDeletion = 'delete' in button.dataset;
  if (isDeletion && !await confirmed('Delete this stack, its results and the zip that was sent? Its scan then misses the view, until it is sent again.', 'Delete')) return;
  button.disabled = true;
  try {
    if (isDeletion) {
      await call('DELETE', href);
      location.assign(link('/scans'));
    } else {
      tell('advice-told', 'The stack is fused again; its page opens', true);
      const made = await json('POST', href, JSON.parse(options));
      location.assign(link(`/stacks/${made.id}`));
    }
  } catch (error) {
    button.disabled = false;
    tell('advice-told', error.message);
  }
}

for (const button of document.querySelectorAll('.findings button[data-href]')) {
  button.addEventListener('click', () => act(button));
}
