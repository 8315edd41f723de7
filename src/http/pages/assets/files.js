// What was dropped or chosen: files with their paths, and how the server groups them into views.
import { json, link } from './page.js';

const PICTURE = /\.(jpe?g|png|tiff?)$/i;
// Folders that systems, file servers and file managers put beside pictures, in lower case. Names that begin with a dot
// are skipped too. The service and the Python client have the same list.
const SKIPPED_FOLDERS = [
  '__macosx', '@eadir', '#recycle', '#snapshot', '@recycle', '@recently-snapshot', '@__thumb', '@transcode', '@tmp',
  '$recycle.bin', 'recycler', 'system volume information', 'lost+found', 'network trash folder', 'temporary items',
];
const SKIPPED_FILES = ['thumbs.db', 'ehthumbs.db', 'desktop.ini'];

function isSkipped(path) {
  const parts = path.toLowerCase().split('/');
  const name = parts.pop();
  return name.startsWith('.') || SKIPPED_FILES.includes(name)
    || parts.some((folder) => folder.startsWith('.') || SKIPPED_FOLDERS.includes(folder));
}

async function entries(folder) {
  const reader = folder.createReader();
  const all = [];
  for (;;) {
    // a reader returns some of them at a time
    const some = await new Promise((resolve, reject) => { reader.readEntries(resolve, reject); });
    if (some.length === 0) return all;
    all.push(...some);
  }
}

async function walk(entry, path, found) {
  const own = path ? `${path}/${entry.name}` : entry.name;
  if (entry.isDirectory) {
    for (const inner of await entries(entry)) await walk(inner, own, found);
  } else {
    found.push({ path: own, file: await new Promise((resolve, reject) => { entry.file(resolve, reject); }) });
  }
}

/** The files of a drop, with those in folders. */
export async function dropped(transfer) {
  // the list of items ends with the event, so all entries are taken first
  const roots = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  const found = [];
  for (const root of roots) await walk(root, '', found);
  return found;
}

/** The files of an input. */
export function chosen(input) {
  return [...input.files].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
}

/** What files are: one zip, or pictures to be packed in the order of their paths. */
export function sorted(files) {
  const useful = files.filter(({ path }) => !isSkipped(path));
  const zips = useful.filter(({ path }) => /\.zip$/i.test(path));
  if (zips.length === 1 && useful.length === 1) return { zip: zips[0].file };
  const pictures = useful.filter(({ path }) => PICTURE.test(path) || /(^|\/)manifest\.json$/i.test(path));
  pictures.sort((a, b) => (a.path < b.path ? -1 : 1));
  return { pictures, others: useful.filter((one) => !pictures.includes(one)), zips };
}

/** The views that the server finds in the names of files: `{ views, ignored }`. Nothing is sent but names. */
export async function grouped(pictures) {
  const names = pictures.map(({ path }) => path);
  const listed = pictures.filter(({ path }) => /(^|\/)manifest\.json$/i.test(path));
  // the server takes the least deep one
  listed.sort((a, b) => a.path.split('/').length - b.path.split('/').length);
  let manifest = null;
  if (listed.length) {
    try { manifest = JSON.parse(await listed[0].file.text()); } catch { throw new Error(`${listed[0].path} is not JSON`); }
  }
  return json('POST', link('/v1/groupings'), { names, manifest });
}
