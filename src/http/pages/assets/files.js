// What was dropped or chosen: files with their paths, and how the server groups them into views.
import { json, link } from './page.js';
import { sourceOf } from './exif.js';
import { directory } from './unzip.js';

const PICTURE = /\.(jpe?g|png|tiff?)$/i;
const isManifest = (path) => /(^|\/)manifest\.json$/i.test(path);
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

// a size costs a question to the system, so each is asked for once
const withSource = ({ path, file }) => ({ path, file, size: file.size, source: sourceOf(file), blob: async () => file });

/**
 * What files are: `{ zip, pictures, others, zips }`. Pictures, and `manifest.json`, are `{ path, size, source, blob }`
 * in the order of their paths: files to be packed, or the members of the one zip that was chosen.
 */
export async function sorted(files) {
  let useful = files.filter(({ path }) => !isSkipped(path));
  const zips = useful.filter(({ path }) => /\.zip$/i.test(path));
  const zip = zips.length === 1 && useful.length === 1 ? zips[0].file : null;
  if (zip) useful = (await directory(zip)).filter(({ path }) => !isSkipped(path));
  const all = zip ? useful.map((one) => ({ ...one, blob: () => one.source.blob() })) : useful.map(withSource);
  const pictures = all.filter(({ path }) => PICTURE.test(path) || isManifest(path));
  pictures.sort((a, b) => (a.path < b.path ? -1 : 1));
  const taken = new Set(pictures);
  return { zip, zips, pictures, others: all.filter((one) => !taken.has(one)) };
}

/** The views that the server finds in the names of files: `{ views, ignored }`. Nothing is sent but names. */
export async function grouped(pictures) {
  const names = pictures.map(({ path }) => path);
  const listed = pictures.filter(({ path }) => isManifest(path));
  // the server takes the least deep one
  listed.sort((a, b) => a.path.split('/').length - b.path.split('/').length);
  let manifest = null;
  if (listed.length) {
    try { manifest = JSON.parse(await (await listed[0].blob()).text()); } catch { throw new Error(`${listed[0].path} is not JSON`); }
  }
  return json('POST', link('/v1/groupings'), { names, manifest });
}
