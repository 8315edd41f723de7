// The list of stacks follows what is in progress, and says aloud what has ended.
import { follow } from './live.js';

const box = document.getElementById('rows');
const told = document.getElementById('told');

function states() {
  return new Map([...box.querySelectorAll('li[data-state]')].map((row) => [row.id, row]));
}

let before = new Map([...states()].map(([id, row]) => [id, row.dataset.state]));
follow(box, 'rows', () => {
  document.querySelector('.empty')?.toggleAttribute('hidden', states().size > 0);
  const ended = [...states()].filter(([id, row]) =>
    ['queued', 'running'].includes(before.get(id)) && !['queued', 'running'].includes(row.dataset.state));
  if (ended.length) {
    told.textContent = ended
      .map(([, row]) => `${row.querySelector('.name').textContent}: ${row.querySelector('.state').innerText}`)
      .join('. ');
  }
  before = new Map([...states()].map(([id, row]) => [id, row.dataset.state]));
});
