// What the scripts of all pages use: calls of the API, errors in words, dialogs.

/** Path of the service for this browser, which may be below a sub-path; this file is at `web/VERSION/page.js` in it. */
const ROOT = new URL('../..', import.meta.url).pathname.slice(0, -1);

/** The URL of a path of the service. */
export const link = (path) => ROOT + path;

/** An error with the sentence of the server. */
export class Refused extends Error {
  constructor(status, detail, code) {
    super(detail);
    this.status = status;
    this.code = code;
  }
}

/** The sentence of a refused answer. */
export async function refusal(response) {
  const body = await response.text().catch(() => '');
  let problem = {};
  try { problem = JSON.parse(body); } catch { /* an answer of a proxy */ }
  const detail = problem.detail || `the server answered with ${response.status} ${response.statusText}`;
  return new Refused(response.status, detail, problem.code);
}

/** Sends a request to this server. Goes to the page that asks for a token when the session has ended, unless that would
 *  end an upload. */
export async function call(method, url, body, headers = {}) {
  let response;
  try {
    response = await fetch(url, { method, body, headers, cache: method === 'GET' ? 'no-cache' : 'no-store' });
  } catch {
    throw new Refused(0, 'the server does not answer; check the network, then try again');
  }
  if (response.status === 401) {
    if (document.querySelector('#uploads progress')) throw new Refused(401, 'your sign-in has ended; sign in in another tab, then try again');
    location.assign(link(`/sign-in?next=${encodeURIComponent(location.pathname.slice(ROOT.length) + location.search)}`));
  }
  if (!response.ok && response.status !== 304) throw await refusal(response);
  return response;
}

/** Sends JSON and returns the JSON of the answer. */
export async function json(method, url, value) {
  const headers = value === undefined ? {} : { 'content-type': 'application/json' };
  const response = await call(method, url, value === undefined ? undefined : JSON.stringify(value), headers);
  return response.status === 204 ? null : response.json();
}

/** A sentence with a capital letter and a full stop. */
export function sentence(detail) {
  const text = detail.charAt(0).toUpperCase() + detail.slice(1);
  return /[.!?]$/.test(text) ? text : `${text}.`;
}

/** Shows an error, or nothing, in the element with this id. */
export function tell(id, detail, good = false) {
  const place = document.getElementById(id);
  place.className = detail ? (good ? 'told ok' : 'error') : '';
  place.textContent = detail ? sentence(detail) : '';
}

/** An element with attributes and children; strings become text. */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== false) made.setAttribute(key, value === true ? '' : value);
  }
  made.append(...children);
  return made;
}

/** Asks for confirmation; true when the person agrees. */
export function confirmed(question, agree) {
  const yes = element('button', { class: 'danger', value: 'yes' }, agree);
  const no = element('button', { value: 'no', autofocus: true }, 'Keep it');
  const text = element('p', { id: 'question' }, question);
  const form = element('form', { method: 'dialog' }, text, element('div', { class: 'buttons' }, no, yes));
  const dialog = element('dialog', { 'aria-labelledby': 'question' }, form);
  document.body.append(dialog);
  return new Promise((resolve) => {
    dialog.addEventListener('close', () => { dialog.remove(); resolve(dialog.returnValue === 'yes'); });
    dialog.showModal();
  });
}

/** A size in words. */
export function bytes(count) {
  const units = ['bytes', 'kB', 'MB', 'GB', 'TB'];
  let unit = 0;
  for (; count >= 999.5 && unit < 4; unit += 1) count /= 1000;
  return `${count.toFixed(unit > 0 && count < 9.95 ? 1 : 0)} ${units[unit]}`;
}

/** A duration in words. */
export function duration(seconds) {
  if (seconds < 100) return `${Math.round(seconds)} s`;
  return seconds < 6000 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}
