// What was dropped or chosen: files with their paths, and how a scan is grouped by its folders.

const PICTURE = /\.(jpe?g|png|tiff?)$/i;
const SKIPPED = /(^|\/)(__MACOSX|\.[^/]*|Thumbs\.db|desktop\.ini)(\/|$)/i;
const BACK = /^(back|backlight|bg)$/i;
const FRONT = /^(front|frontlight|fg)$/i;

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
  const useful = files.filter(({ path }) => !SKIPPED.test(path));
  const zips = useful.filter(({ path }) => /\.zip$/i.test(path));
  if (zips.length === 1 && useful.length === 1) return { zip: zips[0].file };
  const pictures = useful.filter(({ path }) => PICTURE.test(path) || /(^|\/)manifest\.json$/i.test(path));
  pictures.sort((a, b) => (a.path < b.path ? -1 : 1));
  return { pictures, others: useful.filter((one) => !pictures.includes(one)), zips };
}

/** Pictures by folder: views with the numbers of their slices. Folders of lights belong to the folder around them. */
export function grouped(pictures) {
  const views = new Map();
  for (const { path } of pictures) {
    const folders = path.split('/').slice(0, -1);
    const light = folders.at(-1) ?? '';
    const isLight = BACK.test(light) || FRONT.test(light);
    const view = (isLight ? folders.slice(0, -1) : folders).join('/') || '(no folder)';
    const counts = views.get(view) ?? { view, front: 0, back: 0 };
    counts[BACK.test(light) ? 'back' : 'front'] += 1;
    views.set(view, counts);
  }
  return [...views.values()].sort((a, b) => a.view.localeCompare(b.view, undefined, { numeric: true }));
}
