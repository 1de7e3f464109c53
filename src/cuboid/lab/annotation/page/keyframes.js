// The keyframes themselves: what is drawn in which frame, and every change of it.

// So many steps can be undone; a document is some kilobytes.
const STEPS = 300;
// Changes of one kind that follow each other so quickly are undone as one, milliseconds.
const TOGETHER = 900;

let keyframes = data.keyframes;
const done = [];
const undone = [];

const keyframeAt = (frame) => keyframes.frames.find((item) => item.frame === frame);
const objectOf = (id) => keyframes.objects.find((item) => item.id === id);
const boxIn = (frame, id) => keyframeAt(frame)?.boxes.find((box) => box.id === id);
const lookOf = (id) => data.colors[(id - 1) % data.colors.length];
const nameOf = (id) => objectOf(id)?.name ?? `thing ${id}`;
const isGroup = (id) => Boolean(objectOf(id)?.group);
const visibleOf = (box) => box.visible ?? 1;

/** The keyframe from which things are copied into a frame: the last one before it, else the first one after it. */
function sourceOf(frame) {
  const drawn = keyframes.frames.filter((item) => item.frame !== frame && (item.boxes.length || item.ignore?.length));
  const before = drawn.filter((item) => item.frame < frame);
  const nearest = (items, pick) => items.reduce((a, b) => (pick(a.frame, b.frame) === a.frame ? a : b), items[0]);
  return before.length ? nearest(before, Math.max) : nearest(drawn, Math.min);
}

// What the source has, where it should be in the frame that is shown: { frame, source, boxes, ignore }.
let carriedOver = null;

/** Ask the program where things should be: with poses and depth it knows; else they stay where they were. */
async function carryInto(frame) {
  const source = sourceOf(frame);
  if (!source) return null;
  const { boxes, ignore = [] } = source;
  const asked = { from: source.frame, to: frame, rects: [...boxes.map((box) => box.rect), ...ignore] };
  const answer = await post("/carry", asked);
  const rects = answer?.ok ? (await answer.json()).rects : asked.rects;
  return {
    frame,
    source: source.frame,
    boxes: boxes.map((box, i) => ({ ...box, rect: rects[i] })).filter((box) => box.rect),
    ignore: rects.slice(boxes.length).filter(Boolean),
  };
}

/** What came over from the source and this frame has not. */
function ghostsIn(frame) {
  if (carriedOver?.frame !== frame) return [];
  const here = new Set((keyframeAt(frame)?.boxes ?? []).map((box) => box.id));
  return carriedOver.boxes.filter((box) => !here.has(box.id));
}

function ensureKeyframe(frame) {
  let item = keyframeAt(frame);
  if (!item) {
    item = { frame, boxes: [], ignore: [] };
    keyframes.frames.push(item);
    keyframes.frames.sort((a, b) => a.frame - b.frame);
  }
  item.ignore ??= [];
  return item;
}

function newObject() {
  const id = 1 + keyframes.objects.reduce((most, item) => Math.max(most, item.id), 0);
  keyframes.objects.push({ id, name: `thing ${id}` });
  return id;
}

/** Change the keyframes, so that it can be undone; `kind` joins quick changes of one kind. */
function change(edit, kind = null) {
  const before = JSON.stringify(keyframes);
  edit();
  if (JSON.stringify(keyframes) === before) return;
  const last = done.at(-1);
  const joined = kind !== null && last?.kind === kind && Date.now() - last.time < TOGETHER;
  if (joined) last.time = Date.now();
  else done.push({ document: before, frame: state.frame, kind, time: Date.now() });
  if (done.length > STEPS) done.shift();
  undone.length = 0;
  saving.save();
}

/** Go a step back (from `done` to `undone`), or forth again. */
function step(from, to) {
  const last = from.pop();
  if (!last) return;
  to.push({ document: JSON.stringify(keyframes), frame: state.frame, kind: null, time: 0 });
  keyframes = JSON.parse(last.document);
  saving.save();
  state.selected = state.armed = null;
  moveTo(last.frame);
}

function addBox(frame, rect, id) {
  const known = id ?? newObject();
  ensureKeyframe(frame).boxes.push({ id: known, rect, visible: 1 });
  return known;
}

function addIgnored(frame, rect) {
  return ensureKeyframe(frame).ignore.push(rect) - 1;
}

/** Copy boxes of another keyframe, and ignored places into a frame that has none. */
function copyInto(frame, boxes, ignore = []) {
  const item = ensureKeyframe(frame);
  item.boxes.push(...structuredClone(boxes));
  if (!item.ignore.length) item.ignore.push(...structuredClone(ignore));
}

function removeSelected(frame, selected) {
  const item = keyframeAt(frame);
  if (selected.kind === "ignore") item.ignore.splice(selected.index, 1);
  else item.boxes = item.boxes.filter((box) => box.id !== selected.id);
}

/** Let a box of a frame be another object; where that one has a box there already, the two change places. */
function reassign(frame, from, to) {
  const other = boxIn(frame, to);
  const box = boxIn(frame, from);
  if (other) other.id = from;
  box.id = to;
}

function dropObject(id) {
  keyframes.objects = keyframes.objects.filter((item) => item.id !== id);
}

const timesDrawn = (id) => keyframes.frames.filter((item) => item.boxes.some((box) => box.id === id)).length;
