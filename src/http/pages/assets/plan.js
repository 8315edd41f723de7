// What will be done with what was chosen, and what does not fit: told before anything is sent. Which files are slices
// of which view, light and order is the answer of the service (`grouping`), so the rules are its own. Needs no browser.
//
// A finding is `{ level, text, cure }`; the level is `bad` (the service refuses it, or the result is wrong), `warn` or
// `note`.

const few = (names, most = 3) => names.slice(0, most).join(', ') + (names.length > most ? ` and ${names.length - most} more` : '');
const base = (path) => path.split('/').pop();
const many = (count, one, more = `${one}s`) => `${count} ${count === 1 ? one : more}`;
const finding = (level, text, cure) => ({ level, text, cure });
const sizeOf = ({ width, height }) => `${width} × ${height} px`;
const order = ({ width, height }) => [Math.max(width, height), Math.min(width, height)].join();

/** What was chosen is most likely: `stack`, `scan` or `calibration`. */
export function purposeOf({ views, stack }, names) {
  const isTarget = names.length > 0 && names.every((name) => /(^|\/)(calibration|calib|target|dots)\//i.test(name));
  if (stack.moved.length || isTarget) return 'calibration';
  const areViews = views.length > 1 && (stack.problem || views.every(({ pan_deg: pan, tilt_deg: tilt }) => pan !== null || tilt !== null));
  return areViews ? 'scan' : 'stack';
}

/** The views that are sent: those of the scan, or the one stack. */
export function viewsOf(purpose, { views, stack }) {
  if (purpose === 'scan' || (purpose === 'no_target' && views.length > 1)) return views;
  return [{ name: '', pan_deg: null, tilt_deg: null, ...stack }];
}

/** The slices whose heads are read: the first, the middle and the last of each light and view, then the others. */
export function worthReading(views, most) {
  const lights = views.flatMap(({ front, back, lights = [], moved = [] }) => [front, back, moved, ...lights.map(({ slices }) => slices)]);
  const first = lights.flatMap((names) => [names[0], names[names.length >> 1], names.at(-1)]).filter(Boolean);
  return [...new Set([...first, ...lights.flat()])].slice(0, most);
}

/** Slices that were not taken in the order in which they are used, although both directions are in order. */
function outOfTime(names, heads) {
  const known = names.map((name) => [name, heads.get(name)?.taken]).filter(([, taken]) => taken);
  const steps = known.slice(1).map(([name, taken], at) => [known[at], [name, taken]]);
  const later = steps.filter(([a, b]) => b[1] > a[1]);
  const earlier = steps.filter(([a, b]) => b[1] < a[1]);
  const odd = later.length >= earlier.length ? earlier : later;
  return odd.length ? odd[0].map(([name]) => name) : null;
}

function ofHeads(views, heads, profile) {
  const found = [];
  const broken = [...heads].filter(([, head]) => head === null).map(([name]) => base(name));
  if (broken.length) {
    found.push(finding('bad', `${few(broken)}: no JPEG, PNG or TIFF picture, whatever the name says, or cut off`, 'Copy or export it again.'));
  }
  const known = [...heads].filter(([, head]) => head);
  const groups = new Map();
  for (const [name, head] of known) {
    const key = `${order(head)}${head.width >= head.height}${head.orientation}`;
    groups.set(key, [...(groups.get(key) ?? []), [name, head]]);
  }
  const [usual, ...others] = [...groups.values()].sort((a, b) => b.length - a.length);
  for (const odd of others) {
    const [, head] = odd[0];
    const what = order(head) === order(usual[0][1]) ? `turned otherwise (EXIF orientation ${head.orientation})` : sizeOf(head);
    found.push(finding('bad', `${few(odd.map(([name]) => base(name)))}: ${what}; the others have ${sizeOf(usual[0][1])}`,
      'Send pictures of one size and orientation, as the camera wrote them.'));
  }
  if (usual && profile && order(usual[0][1]) !== order({ width: profile.image_width, height: profile.image_height })) {
    found.push(finding('bad', `The slices have ${sizeOf(usual[0][1])}, and the profile is for ${profile.image_width} × ${profile.image_height} px`,
      'Send pictures as the camera wrote them, choose another lens, or calibrate at this size.'));
  }
  for (const view of views.slice(0, 50)) {
    const odd = outOfTime(view.front, heads);
    if (odd) {
      found.push(finding('warn', `By its EXIF time ${base(odd[1])} was not taken after ${base(odd[0])}`, 'If the order is wrong, rename the files or list them in a manifest.json.'));
      break;
    }
  }
  return found;
}

function ofCounts(purpose, views, profile) {
  const found = [];
  if (purpose === 'stack' || purpose === 'scan') {
    const count = profile?.slice_count;
    const wrong = views.filter(({ front }) => front.length > 0 && count && front.length !== count);
    if (wrong.length) {
      const which = views.length === 1 ? 'The stack' : few(wrong.map(({ name }) => name));
      const slices = [...new Set(wrong.map(({ front }) => front.length))].join(' or ');
      found.push(finding('bad', `${which} ${wrong.length > 1 ? 'have' : 'has'} ${slices} slices, and the profile of this rig and lens has ${count}`,
        'Add or remove slices, choose another lens, or calibrate with this number.'));
    }
    const dark = views.filter(({ front, back }) => front.length > 0 && back.length === 0);
    if (dark.length && dark.length < views.length) {
      found.push(finding('warn', `${few(dark.map(({ name }) => name))}: no back light, which the other views have`, 'Add its slices in a folder back; without them there is no mask.'));
    } else if (dark.length) {
      found.push(finding('note', 'No back light: the result has no mask', 'For one, add slices against the light in a folder back beside front.'));
    }
  }
  for (const { name, gaps } of views.filter(({ gaps }) => gaps).slice(0, 5)) {
    found.push(finding('warn', `${name ? `${name}: a` : 'A'} slice may be missing: ${gaps}`, 'Add it, or photograph this view again: a gap shifts all slices behind it.'));
  }
  return found;
}

/**
 * What will be done: `{ title, views, findings }`. `heads` maps names to what `exif.js` read of them, as far as it is
 * read; `profile` is that of the rig and lens: null where there is none, undefined where it is not known.
 */
export function planOf({ purpose, grouping, heads, profile, others = [], rig, lens }) {
  const views = viewsOf(purpose, grouping);
  const [first] = views;
  const findings = [];
  const problems = views.filter(({ problem }) => problem);
  if (purpose === 'scan' && views.length < 2) {
    findings.push(finding('bad', 'The names tell no two views apart', 'Put each view into a folder of its own, or choose “One stack”.'));
  }
  if (purpose === 'stack' && first.moved.length) {
    findings.push(finding('bad', `${few(first.moved.map(base))}: pictures of a moved target, which a stack does not have`, 'Choose “A calibration: a dot target”, or rename the folder.'));
  }
  if (purpose === 'stack' && grouping.views.length > 1 && problems.length) {
    findings.push(finding('bad', `These are ${grouping.views.length} views`, 'If they are views of one object, choose “A scan”; otherwise send one at a time.'));
    problems.length = 0;
  }
  for (const { problem } of problems.slice(0, 5)) findings.push(finding('bad', problem, ''));
  if (problems.length > 5) findings.push(finding('bad', `${problems.length - 5} more views cannot be sent as they are`, 'They are marked in the table.'));
  if (profile === null && (purpose === 'stack' || purpose === 'scan')) {
    findings.push(finding('bad', `There is no profile of the rig ${rig} with the lens ${lens}`, 'Choose names that were calibrated, or calibrate first.'));
  }
  findings.push(...ofCounts(purpose, views, profile), ...ofHeads(views, heads, purpose === 'stack' || purpose === 'scan' ? profile : null));
  const ignored = grouping.ignored.filter(({ name }) => !/manifest\.json$/i.test(name));
  if (purpose === 'scan' && ignored.length) findings.push(finding('note', `${many(ignored.length, 'file')} of no view: ${few(ignored.map(({ name, reason }) => `${base(name)} (${reason})`), 2)}`, ''));
  if (others.length) findings.push(finding('note', `${many(others.length, 'other file is', 'other files are')} not sent: ${few(others.map(base))}`, ''));
  const rank = { bad: 0, warn: 1, note: 2 };
  findings.sort((a, b) => rank[a.level] - rank[b.level]);
  const lights = (first?.lights ?? []).map(({ name }) => name);
  const light = (first?.back.length ? 'front and back light' : 'front light') + (lights.length ? `, and ${lights.join(', ')}` : '');
  const slices = first ? many(first.front.length, 'slice') : 'no slices';
  const title = {
    stack: `One stack: ${slices}, ${light}`,
    scan: `A scan: ${many(views.length, 'view')}${first ? ` of ${slices}, ${light}` : ''}`,
    calibration: `A dot target: ${slices}${first?.moved?.length ? `, and ${many(first.moved.length, 'picture')} of it moved` : ''}`,
    no_target: `A calibration without a target: ${many(views.length, 'view')}${first ? ` of ${slices}` : ''}`,
  }[purpose];
  return { title, views, findings };
}
