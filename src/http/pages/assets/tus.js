// Sends a Blob by tus 1.0.0 (core and creation): in pieces, each of which is on the disk of the server before the next
// one begins. After an error it asks how much has arrived, and goes on from there. The URL of an unfinished upload is
// kept in the browser under a key that the caller makes of the file and its options.
import { link, Refused } from './page.js';

const PIECE = 16 * 1024 * 1024;
const PAUSES_S = [1, 2, 5, 10, 20, 30];
/** Between two looks whether the person has signed in again; a return to the page is looked at as well. */
const SIGNED_OUT_S = 5;
const PREFIX = 'pinstack-upload-';

const base64 = (text) => btoa(String.fromCharCode(...new TextEncoder().encode(text)));

function kept(key) {
  try { return localStorage.getItem(PREFIX + key); } catch { return null; }
}
function keep(key, url) {
  try {
    if (url) localStorage.setItem(PREFIX + key, url); else localStorage.removeItem(PREFIX + key);
  } catch { /* without it, an upload cannot be continued after a reload */ }
}

/** A resumable upload. `told` is called with `{state, sent, total, detail}` whenever something changes. */
export class Upload {
  constructor(blob, metadata, key, told) {
    Object.assign(this, { blob, metadata, key, told, sent: 0, isPaused: false, attempt: 0 });
    for (const event of ['online', 'focus']) window.addEventListener(event, () => this.wake?.());
  }

  tell(state, detail) { this.told({ state, sent: this.sent, total: this.blob.size, detail }); }

  /** Sends everything; returns the URL of the job, or null when it was removed or refused. */
  async run() {
    for (;;) {
      if (this.isRemoved) return null;
      if (this.isPaused) {
        this.tell('paused');
        await new Promise((resolve) => { this.wake = resolve; });
        continue;
      }
      try {
        if (!this.url || this.isUnsure) await this.begin();
        this.isUnsure = false;
        while (this.job === undefined && !this.isPaused && !this.isRemoved) await this.piece();
        if (this.job !== undefined) {
          keep(this.key, null);
          return this.job;
        }
      } catch (error) {
        if (this.isPaused || this.isRemoved) { this.isUnsure = true; continue; }
        if (error.isGone) { keep(this.key, null); this.url = null; this.sent = 0; continue; }
        if (error.status === 401) {
          this.isUnsure = true;
          this.tell('signed_out');
          await this.wait(SIGNED_OUT_S);
          continue;
        }
        // the URL stays: once a right or a proxy is mended, the upload goes on; a refused one begins anew
        if (!isTemporary(error.status)) throw error;
        this.isUnsure = true;
        await this.pause(error);
      }
    }
  }

  async pause(error) {
    const seconds = PAUSES_S[Math.min(this.attempt, PAUSES_S.length - 1)];
    this.attempt += 1;
    this.tell('waiting', `${error.message}; the next attempt is in ${seconds} s`);
    await this.wait(seconds);
  }

  /** Waits this long, or until something happens that may help. */
  wait(seconds) {
    return new Promise((resolve) => { this.wake = resolve; setTimeout(resolve, seconds * 1000); });
  }

  /** Finds how much has arrived, or begins a new upload. */
  async begin() {
    this.url ??= kept(this.key);
    if (this.url) {
      const known = await this.request('HEAD', this.url);
      if (known.ok && Number(known.header('Upload-Length')) === this.blob.size) {
        this.sent = Number(known.header('Upload-Offset'));
        this.job = known.header('Pinstack-Job') ?? undefined;
        this.tell('sending');
        if (this.job === undefined && this.sent === this.blob.size) await this.piece();
        return;
      }
      if (isTemporary(known.status) || [401, 403].includes(known.status)) throw known.error();
      this.url = null;
    }
    const metadata = Object.entries(this.metadata).map(([name, value]) => `${name} ${base64(value)}`).join(',');
    const made = await this.request('POST', link('/v1/uploads'), null, { 'Upload-Length': this.blob.size, 'Upload-Metadata': metadata });
    if (!made.ok) throw made.error();
    this.url = made.header('Location');
    this.sent = 0;
    keep(this.key, this.url);
  }

  async piece() {
    const from = this.sent;
    const bytes = this.blob.slice(from, Math.min(from + PIECE, this.blob.size));
    const headers = { 'Upload-Offset': from, 'Content-Type': 'application/offset+octet-stream' };
    const answer = await this.request('PATCH', this.url, bytes, headers, (sent) => {
      this.sent = from + sent;
      this.tell('sending');
    });
    if (answer.status === 404 || answer.status === 410) throw Object.assign(answer.error(), { isGone: true });
    if (answer.status === 409) { this.isUnsure = true; throw Object.assign(answer.error(), { status: 0 }); }
    if (!answer.ok) throw answer.error();
    this.attempt = 0;
    this.sent = Number(answer.header('Upload-Offset'));
    this.tell(this.sent === this.blob.size ? 'checking' : 'sending');
    const job = answer.header('Pinstack-Job');
    if (job) this.job = job;
  }

  /** XMLHttpRequest, because `fetch` tells nothing of the progress of a body. */
  request(method, url, body = null, headers = {}, progress = () => {}) {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      this.current = request;
      request.open(method, url);
      request.setRequestHeader('Tus-Resumable', '1.0.0');
      for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
      request.upload.onprogress = (event) => {
        progress(event.loaded);
        // the last bytes are on their way: the server checks the zip before it answers
        if (this.sent >= this.blob.size) this.tell('checking');
      };
      const cut = () => reject(new Refused(0, 'the line to the server is cut'));
      request.onerror = cut;
      request.onabort = cut;
      request.ontimeout = cut;
      request.onload = () => resolve({
        ok: request.status >= 200 && request.status < 300,
        status: request.status,
        header: (name) => request.getResponseHeader(name),
        error: () => {
          let problem = {};
          try { problem = JSON.parse(request.responseText); } catch { /* no problem document */ }
          return new Refused(request.status, problem.detail ?? `the server answered with ${request.status}`, problem.code);
        },
      });
      request.send(body);
    });
  }

  setPaused(isPaused) {
    this.isPaused = isPaused;
    if (isPaused) this.current?.abort();
    this.wake?.();
  }

  /** Ends the upload, here and on the server. */
  remove() {
    this.isRemoved = true;
    this.current?.abort();
    keep(this.key, null);
    if (this.url) fetch(this.url, { method: 'DELETE', headers: { 'Tus-Resumable': '1.0.0' } }).catch(() => {});
    this.wake?.();
  }
}

/** Whether the same request may succeed later. */
function isTemporary(status) {
  return status === 0 || status === 408 || status === 423 || status === 429 || status === 460 || status >= 500;
}
