// The state of the page, and the updates after each change of it.

const state = {
  theme: "dark",
  coloring: "color",
  layers: { boxes: true, planes: true, furniture: true, camera: true, changes: true, cut: true },
  selected: null,
  frame: null, // index among the used frames; null is all frames at once
  follow: false,
  wanted: null, // labels that match the search; null is all
  least: 0, // smallest probability of the objects that are shown
};

let scene = null;
let orbit = null;
let tags = null;
let ruler = null;
let pending = 0;
let untouched = true; // nobody has chosen a point of view yet

function redraw() {
  if (!scene || pending) return;
  pending = requestAnimationFrame(() => {
    pending = 0;
    if (find("scene").hidden) return;
    const { ratio } = scene.renderer;
    scene.renderer.fit();
    if (ratio !== scene.renderer.ratio) scene.update(); // the window has moved to another screen
    const eye = orbit.eye();
    scene.draw(eye);
    tags.place(eye, (object) => scene.stateOf(object));
    ruler.place(eye);
    showScale(orbit, find("canvas").clientHeight);
  });
}

function update(change) {
  Object.assign(state, change);
  document.documentElement.dataset.theme = state.theme;
  for (const button of document.querySelectorAll("[data-coloring]"))
    button.setAttribute("aria-pressed", String(button.dataset.coloring === state.coloring));
  for (const button of document.querySelectorAll("[data-layer]"))
    button.setAttribute("aria-pressed", String(state.layers[button.dataset.layer]));
  find("look-through").setAttribute("aria-pressed", String(state.follow));
  timeline.update();
  panel.update();
  changes.update();
  picture.update();
  if (scene) scene[change.theme ? "update" : "updateFrame"]();
  redraw();
}

/** Select an object, or none; choosing the selected object deselects it. */
function choose(label) {
  update({ selected: label === state.selected ? null : label });
  if (state.selected !== null) timeline.reveal(state.selected);
}

function moveTo(frame) {
  update({ frame: frame === null ? null : clamp(frame, 0, frames.length - 1), follow: state.follow && frame !== null });
  if (state.follow) orbit.set(orbit.behind(poseOf(state.frame)));
}

function followCamera(follow) {
  if (!frames.length || !orbit) return;
  untouched = false;
  if (!follow) lookAtAll();
  update({ follow, frame: state.frame === null && follow ? 0 : state.frame });
  if (follow) orbit.fly(orbit.behind(poseOf(state.frame)));
}

// Recordings have about 30 frames/s; the refresh rate of a screen may be higher or lower.
let playing = null;
function play(start) {
  if (playing) clearInterval(playing);
  playing = null;
  find("play").classList.toggle("playing", start);
  if (!start || !frames.length) return;
  if (state.frame === null || state.frame >= frames.length - 1) moveTo(0);
  const rate = 33 * (data.run.config.every || 1);
  playing = setInterval(() => (state.frame < frames.length - 1 ? moveTo(state.frame + 1) : play(false)), clamp(rate, 33, 200));
}

/** Look at all objects from the best side. */
function lookAtAll(milliseconds = 500) {
  untouched = true;
  orbit.fly(startView(orbit, tags, scene), milliseconds);
}

function setUpScene() {
  const canvas = find("canvas");
  const renderer = new Renderer(canvas);
  scene = new Scene(renderer, state);
  orbit = new Orbit(canvas, redraw, () => {
    untouched = false;
    if (state.follow) update({ follow: false });
  });
  tags = new Tags(find("tags"), state, choose);
  ruler = scene.ruler = new Ruler(state, scene, orbit, () => {
    scene.updateRuler();
    redraw();
  });
  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  canvas.addEventListener("click", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    if (ruler.active) return ruler.click(event.offsetX, event.offsetY);
    const { origin, direction } = orbit.ray(event.offsetX, event.offsetY);
    const object = scene.pick(origin, direction);
    return object && choose(object.label);
  });
  canvas.addEventListener("dblclick", (event) => {
    if (ruler.active) return;
    const { origin, direction } = orbit.ray(event.offsetX, event.offsetY);
    const object = scene.pick(origin, direction);
    if (object) approach(object.center, object.size);
    if (object) update({ selected: object.label });
  });
  new ResizeObserver(() => {
    showHint(canvas.clientWidth);
    tags.layout();
    if (untouched && scene.points && canvas.clientWidth) lookAtAll(0);
    redraw();
  }).observe(canvas);
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => location.reload());
  renderer.fit();
  return scene.load().then(() => {
    if (untouched && canvas.clientWidth) lookAtAll(0);
    document.body.dataset.ready = "true";
    redraw();
  });
}

function showTab(name) {
  for (const tab of ["scene", "run"]) {
    find(tab).hidden = tab !== name;
    find(`tab-${tab}`).setAttribute("aria-selected", String(tab === name));
  }
  redraw();
}

/** On a phone, the list or the timeline is below the scene. */
function showBelow(name) {
  find("scene").dataset.below = name;
  for (const button of document.querySelectorAll("[data-below]"))
    button.setAttribute("aria-pressed", String(button.dataset.below === name));
  timeline.draw();
}

function setUpKeys() {
  const actions = {
    " ": () => play(!playing),
    ArrowRight: () => moveTo((state.frame ?? -1) + 1),
    ArrowLeft: () => moveTo((state.frame ?? frames.length) - 1),
    Escape: () => (ruler && ruler.active ? ruler.use(false) : state.selected !== null ? choose(null) : moveTo(null)),
    ...VIEW_KEYS,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || find("scene").hidden || find("compare").open) return;
    if (event.target.type === "range" && event.key.startsWith("Arrow")) return; // a slider moves by itself
    if (event.target.closest("button") && event.key === " ") return;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || !frames.length) return;
    event.preventDefault();
    action();
  });
}

function setUpHeader() {
  find("title").replaceChildren(element("small", {}, data.place), data.title);
  const { run } = data;
  const facts = [plural(data.objects.length, "object"), plural(run.frames.used, "frame")];
  if (furniture.length) facts.splice(1, 0, `${plural(furniture.length, "piece")} of furniture`);
  document.querySelector('[data-layer="furniture"]').hidden = !furniture.length;
  find("facts").textContent = facts.join("  ·  ");
  if (!run.complete) find("facts").prepend(element("span", { class: "warning" }, "interrupted, not complete"));
  showWarnings([...(run.complete ? [] : ["The run was interrupted: these results are not complete."]), ...run.warnings]);
}

function setUpButtons() {
  for (const tab of ["scene", "run"]) find(`tab-${tab}`).addEventListener("click", () => showTab(tab));
  find("theme").addEventListener("click", () => update({ theme: state.theme === "dark" ? "light" : "dark" }));
  find("play").addEventListener("click", () => play(!playing));
  find("all-frames").addEventListener("click", () => {
    play(false);
    moveTo(null);
  });
  find("look-home").addEventListener("click", () => {
    update({ follow: false });
    lookAtAll();
  });
  find("look-down").addEventListener("click", () => {
    update({ follow: false });
    untouched = false;
    orbit.fly(framed(orbit, cornersShown((object) => scene.stateOf(object)), orbit.place.yaw, STEEPEST));
  });
  for (const button of document.querySelectorAll("[data-below]"))
    button.addEventListener("click", () => showBelow(button.dataset.below));
  find("look-through").addEventListener("click", () => followCamera(!state.follow));
  for (const button of document.querySelectorAll("[data-coloring]"))
    button.addEventListener("click", () => update({ coloring: button.dataset.coloring }));
  for (const button of document.querySelectorAll("[data-layer]"))
    button.addEventListener("click", () => {
      const { layer } = button.dataset;
      update({ layers: { ...state.layers, [layer]: !state.layers[layer] } });
    });
}

/** The frame that shows the most objects: the initial frame of a page with pictures. */
function richestFrame() {
  const seen = Array.from(frames, (frame) => data.objects.filter((object) => stateIn(object, frame) === "seen").length);
  return seen.indexOf(Math.max(...seen));
}

const timeline = new Timeline(state, choose, (frame) => {
  play(false);
  moveTo(frame);
});
/** Look at an object, or at the place of a removed object. */
function approach(target, size) {
  untouched = false;
  if (orbit) orbit.fly({ target, distance: clamp(5 * norm(size), 0.4, orbit.span), fovY: FOV_Y });
  update({ follow: false });
}

/** List and timeline show only the objects that match the search. */
function wish(wanted) {
  update({ wanted });
  timeline.draw();
}

/** The page shows only the objects with at least this probability. */
function limit(least) {
  const object = objectOf.get(state.selected);
  update({ least, selected: object && object.probability < least ? null : state.selected });
  if (scene) scene.colorPoints();
  timeline.draw();
}

function showName(object) {
  for (const one of changed) if (one.label === object.label) one.name = object.name;
  changes.list();
  if (tags) tags.rename(object);
  picture.again();
  wish(panel.search.wanted());
}

const panel = new Panel(state, { chosen: choose, moved: moveTo, wished: wish, named: showName });
const changes = new Changes(state, choose, approach);
const picture = new Picture(state);

state.theme = window.matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
find("notice").append(" · double click to look at");
setUpHeader();
setUpButtons();
setUpKeys();
setUpPhone();
setUpDividers();
setUpToolbar(() => tags && tags.layout());
for (const [id, rows] of [["panel", ".object, .change"], ["rows", ".row"]]) new More(find(id), rows);
state.least = setUpLeast(limit);
find("likely").hidden = !data.objects.length;
showBelow("list");
fillRunTab();
timeline.draw();
update({ frame: data.live && data.live.pictures && frames.length ? richestFrame() : null });

try {
  setUpScene().catch((error) => refuse(error));
  update({ theme: state.theme });
} catch (error) {
  refuse(error);
}

function refuse(error) {
  scene = null;
  find("notice").hidden = false;
  find("notice").textContent = `The 3D view needs a browser with WebGL 2 (${error.message}). Objects and timeline are still available.`;
  find("view").classList.add("refused");
}
