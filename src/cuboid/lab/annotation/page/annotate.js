// What is shown, and what the user can do.

const state = {
  theme: window.matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark",
  frame: keyframes.frames.at(-1)?.frame ?? 0,
  tool: "object",
  selected: null, // { kind: "object", id } or { kind: "ignore", index }
  armed: null, // the object that the next rectangle is
};

const pictures = new Pictures();
const saving = new Saving(find("saved"));
const board = new Board();
const card = new Card();
const way = new Way();

const isSelected = (thing) =>
  state.selected?.kind === thing.kind && (thing.kind === "ignore" ? state.selected.index === thing.index : state.selected.id === thing.id);

/** What has the rectangle of something chosen, as its field `rect`. */
function rectHolder(selected) {
  if (selected.kind === "object") return boxIn(state.frame, selected.id);
  const { ignore } = keyframeAt(state.frame);
  return {
    get rect() { return ignore[selected.index]; },
    set rect(rect) { ignore[selected.index] = rect; },
  };
}

function update(changed) {
  Object.assign(state, changed);
  document.documentElement.dataset.theme = state.theme;
  for (const tool of document.querySelectorAll("[data-tool]")) tool.setAttribute("aria-pressed", String(tool.dataset.tool === state.tool));
  find("undo").disabled = !done.length;
  find("redo").disabled = !undone.length;
  const missing = ghostsIn(state.frame).length;
  find("copying").hidden = !missing;
  if (missing) find("copy").textContent = `Copy ${missing} from frame ${carriedOver.source}`;
  const rects = keyframes.frames.reduce((sum, item) => sum + item.boxes.length, 0);
  find("facts").textContent = `${plural(keyframes.frames.length, "keyframe")}  ·  ${plural(rects, "rectangle")}`;
  find("notice").textContent = hint();
  card.update();
  listObjects();
  way.update();
  board.hover();
  board.draw();
  document.body.dataset.frame = state.frame;
}

function hint() {
  if (state.tool === "ignore") return "drag over places that count neither way · O draws objects again";
  if (state.armed) return `drag to draw ${state.armed}  ${nameOf(state.armed)} · Esc lets it go`;
  if (state.selected) return "drag to move · handles resize · 1 to 9, 0: how much is visible · Enter: its name · Del";
  if (ghostsIn(state.frame).length) return "drag to draw · C copies the dashed ones, a click one of them · Page Down: next frame";
  return "drag to draw · wheel zooms · Page Down: next suggested frame · ? shows all keys";
}

async function moveTo(frame) {
  const wanted = clamp(frame, 0, data.count - 1);
  if (board.drag) return;
  const selected = state.selected?.kind === "object" && boxIn(wanted, state.selected.id) ? state.selected : null;
  update({ frame: wanted, selected, armed: null });
  const [{ image, reason }, carried] = await Promise.all([pictures.of(wanted), carryInto(wanted)]);
  if (state.frame !== wanted) return;
  carriedOver = carried;
  board.show(image ?? null);
  update({});
  if (reason) find("notice").textContent = reason;
  document.body.dataset.shown = wanted;
  for (const direction of [1, -1]) {
    const stop = nextStop(wanted, direction);
    if (stop !== undefined) pictures.of(stop);
  }
}

function toStop(direction) {
  const stop = nextStop(state.frame, direction);
  if (stop !== undefined) moveTo(stop);
}

const select = (thing) => update({ selected: thing && { kind: thing.kind, id: thing.id, index: thing.index }, armed: null });

/** Choose an object where it is drawn, else let the next rectangle be it. */
function chooseObject(id) {
  if (boxIn(state.frame, id)) select({ kind: "object", id });
  else update({ armed: state.armed === id ? null : id, selected: null, tool: "object" });
}

/** A new rectangle was drawn. */
function drawn(rect) {
  if (state.tool === "ignore") {
    let index;
    change(() => (index = addIgnored(state.frame, rect)));
    select({ kind: "ignore", index });
    return;
  }
  const known = state.armed;
  let id;
  change(() => (id = addBox(state.frame, rect, known)));
  select({ kind: "object", id });
  if (!known) rename();
}

function rename() {
  find("name")?.focus();
  find("name")?.select();
}

function copyGhost(id) {
  change(() => copyInto(state.frame, ghostsIn(state.frame).filter((box) => box.id === id)));
  select({ kind: "object", id });
}

function copyAll() {
  const boxes = ghostsIn(state.frame);
  if (!boxes.length) return;
  change(() => copyInto(state.frame, boxes, carriedOver.ignore));
  select(null);
}

function removeChosen() {
  if (!state.selected) return;
  change(() => removeSelected(state.frame, state.selected));
  select(null);
}

function ignoreInstead() {
  let index;
  const { rect } = rectHolder(state.selected);
  change(() => {
    removeSelected(state.frame, state.selected);
    index = addIgnored(state.frame, rect);
  });
  select({ kind: "ignore", index });
}

function objectInstead() {
  let id;
  const { rect } = rectHolder(state.selected);
  change(() => {
    removeSelected(state.frame, state.selected);
    id = addBox(state.frame, rect, null);
  });
  select({ kind: "object", id });
  rename();
}

function setVisible(share) {
  if (state.selected?.kind !== "object") return;
  change(() => (boxIn(state.frame, state.selected.id).visible = share), `visible ${state.selected.id}`);
  update({});
}

function toggleGroup() {
  if (state.selected?.kind !== "object") return;
  change(() => {
    const item = objectOf(state.selected.id);
    if (item.group) delete item.group;
    else item.group = true;
  });
  update({});
}

/** Make the frame a keyframe with nothing in it, or none any more. */
function toggleKeyframe() {
  change(() => {
    if (keyframeAt(state.frame)) keyframes.frames = keyframes.frames.filter((item) => item.frame !== state.frame);
    else ensureKeyframe(state.frame);
  });
  select(null);
}

function nudge(dx, dy) {
  if (!state.selected) return;
  const holder = rectHolder(state.selected);
  const [x0, y0, x1, y1] = holder.rect;
  const [mx, my] = [clamp(dx, -x0, data.width - x1), clamp(dy, -y0, data.height - y1)];
  change(() => (holder.rect = [x0 + mx, y0 + my, x1 + mx, y1 + my]), "nudge");
  update({});
}

function letGo() {
  if (board.cancel()) return;
  if (state.selected || state.armed) update({ selected: null, armed: null });
  else update({ tool: "object" });
}

const undo = () => step(done, undone);
const redo = () => step(undone, done);
const showHelp = () => (find("help").open ? find("help").close() : find("help").showModal());

// Keys, what they do, and how the help says it; those without words are second names.
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const KEYS = [
  ["PageDown", () => toStop(1), "Page Down, .", "next suggested frame or keyframe"],
  ["PageUp", () => toStop(-1), "Page Up, ,", "the one before"],
  [".", () => toStop(1)],
  [",", () => toStop(-1)],
  ["ArrowRight", () => moveTo(state.frame + 1), "→ ←", "next frame, the one before; with Shift 10 frames"],
  ["ArrowLeft", () => moveTo(state.frame - 1)],
  ["Shift+ArrowRight", () => moveTo(state.frame + 10)],
  ["Shift+ArrowLeft", () => moveTo(state.frame - 10)],
  ["c", copyAll, "C", "copy all that is missing here from the keyframe before"],
  ["Enter", rename, "Enter", "name the chosen object; Enter again: done"],
  ...[..."1234567890"].map((digit) => [digit, () => setVisible(Number(digit) / 10 || 1)]),
  [null, null, "1 … 9, 0", "visible: 0.1 … 0.9, 1.0"],
  ["g", toggleGroup, "G", "group or not"],
  ["Delete", removeChosen, "Del", "delete the chosen rectangle"],
  ["Backspace", removeChosen],
  ...Object.entries(ARROWS).flatMap(([key, [x, y]]) => [
    [`Alt+${key}`, () => nudge(x, y)],
    [`Alt+Shift+${key}`, () => nudge(10 * x, 10 * y)],
  ]),
  [null, null, "Alt + arrows", "move it by a pixel; with Shift by 10"],
  ["o", () => update({ tool: "object" }), "O", "draw objects"],
  ["i", () => update({ tool: "ignore", selected: null, armed: null }), "I", "draw ignored places"],
  ["k", toggleKeyframe, "K", "keyframe with nothing in it, or none any more"],
  ["Ctrl+z", undo, "Ctrl + Z", "undo"],
  ["Ctrl+Shift+z", redo, "Ctrl + Shift + Z", "redo"],
  ["Ctrl+y", redo],
  ["f", () => board.fit(), "F", "the whole picture"],
  ["+", () => zoomMiddle(1.25), "+ −", "zoom"],
  ["-", () => zoomMiddle(0.8)],
  ["Escape", letGo, "Esc", "let go"],
  ["?", showHelp, "?", "this page"],
];

const zoomMiddle = (factor) => board.zoomAt(board.place.clientWidth / 2, board.place.clientHeight / 2, factor);

function setUpKeys() {
  const actions = new Map(KEYS.filter(([key]) => key).map(([key, action]) => [key, action]));
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input[type=text], select") || (find("help").open && event.key !== "?")) return;
    if (event.target.matches("button") && ["Enter", " "].includes(event.key)) return;
    if (event.target.matches("#visible") && event.key in ARROWS) return;
    const single = event.key.length === 1;
    const held = [(event.ctrlKey || event.metaKey) && "Ctrl", event.altKey && "Alt", event.shiftKey && (!single || event.ctrlKey || event.metaKey) && "Shift"];
    const action = actions.get([...held.filter(Boolean), single ? event.key.toLowerCase() : event.key].join("+"));
    if (!action) return;
    event.preventDefault();
    action();
  });
  for (const [, , keys, text] of KEYS.filter((entry) => entry[3]))
    find("keys").append(element("dt", {}, keys), element("dd", {}, text));
}

function setUpButtons() {
  const actions = { undo, redo, copy: copyAll, fit: () => board.fit(), "show-help": showHelp, "close-help": showHelp };
  for (const [id, action] of Object.entries(actions)) find(id).addEventListener("click", action);
  find("theme").addEventListener("click", () => update({ theme: state.theme === "dark" ? "light" : "dark" }));
  for (const tool of document.querySelectorAll("[data-tool]"))
    tool.addEventListener("click", () => update({ tool: tool.dataset.tool, selected: null, armed: null }));
  find("help").addEventListener("click", (event) => event.target === find("help") && find("help").close());
}

find("title").replaceChildren(element("small", {}, data.place), data.title);
find("desk").style.setProperty("--aspect", (data.width / data.height).toFixed(4));
new More(find("panel"), "#objects li");
setUpKeys();
setUpButtons();
board.fit();
moveTo(state.frame).then(() => (document.body.dataset.ready = "true"));
