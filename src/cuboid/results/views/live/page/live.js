// Requests new data from the running program, and shows them.

const state = {
  theme: window.matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark",
  coloring: "color",
  layers: { boxes: true, planes: true, camera: true, cut: true },
  selected: null,
  frame: null,
  follow: false,
  camera: null, // of a rig, the number of the one whose picture is enlarged
  wanted: null,
  least: 0,
};

// Pause after a request without an answer, milliseconds.
const PAUSE = 1000;

const pause = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

const canvas = find("canvas");
let scene, orbit, tags, ruler;
let drawing = 0;
let touched = false;

function redraw() {
  if (drawing) return;
  drawing = requestAnimationFrame(() => {
    drawing = 0;
    scene.renderer.fit();
    const eye = orbit.eye();
    scene.draw(eye);
    tags.place(eye, (object) => scene.stateOf(object));
    ruler.place(eye);
    showScale(orbit, canvas.clientHeight);
  });
}

function update(change) {
  Object.assign(state, change);
  document.documentElement.dataset.theme = state.theme;
  for (const name of ["coloring", "layer"])
    for (const button of document.querySelectorAll(`[data-${name}]`))
      button.setAttribute(
        "aria-pressed",
        String(name === "layer" ? state.layers[button.dataset.layer] : state.coloring === button.dataset.coloring),
      );
  find("look-through").setAttribute("aria-pressed", String(state.follow));
  listObjects();
  scene.update();
  redraw();
}

const search = new Search((wanted) => update({ wanted }));
const choose = (label) => update({ selected: label === state.selected ? null : label });

function listObjects() {
  state.wanted = search.wanted(); // among the present objects of the map
  find("object-count").textContent = countOf(state);
  find("objects").replaceChildren(
    ...wantedObjects(state).map((object) => {
      const selected = object.label === state.selected;
      const row = objectRow(object, choose, null, selected);
      row.classList.toggle("hidden-now", !object.seen);
      row.setAttribute("aria-pressed", String(selected));
      return element("li", {}, row);
    }),
  );
}

/** The latest events, the newest first. */
function listEvents(events) {
  find("events").hidden = !events.length;
  find("events").querySelector("ul").replaceChildren(
    ...[...events].reverse().map((one) => {
      const known = data.objects.find(({ label }) => label === one.label) || one;
      const words = element("span", { class: `kind ${one.event}` }, wordsOf(one));
      return element("li", {}, chip(known), words, element("small", {}, `frame ${one.frame}`));
    }),
  );
}

/** Make new tags if labels have changed; otherwise move the old tags, so that a click on a moving tag still works. */
function placeTags() {
  const labels = (items) => items.map(({ label }) => label).join();
  if (labels(tags.tags.map(({ object }) => object)) !== labels(data.objects)) {
    find("tags").replaceChildren();
    tags = new Tags(find("tags"), state, choose);
    return;
  }
  tags.tags.forEach((item, i) => {
    item.object = data.objects[i];
    item.top = add(item.object.center, scale(axis(item.object.rotation, 2), item.object.size[2] / 2));
  });
}

/** Show the decoded pictures in place of the previous ones, so that nothing flickers; of a rig, side by side. */
function showPictures(cameras, pictures) {
  const several = cameras.length > 1;
  if (find("picture").children.length !== cameras.length || several !== find("picture").classList.contains("several")) {
    find("picture").replaceChildren(...cameras.map((camera, k) => (several ? tile(camera.name, k) : element("div", { class: "framed" }))));
    find("picture").classList.toggle("several", several);
  }
  [...find("picture").children].forEach((place, k) => {
    pictures[k].alt = several ? "" : "Picture of the camera";
    place.querySelector("img")?.remove();
    place.prepend(pictures[k]);
    if (!several) return;
    place.classList.toggle("ended", cameras[k].ended);
    place.querySelector("span").textContent = cameras[k].name + (cameras[k].ended ? " · no frames" : "");
    place.setAttribute("aria-pressed", String(k === state.camera));
  });
}

/** The place of the picture of one of several cameras; a click enlarges it. */
function tile(name, k) {
  const made = element("button", { class: "framed", title: `Enlarge the picture of ${name}` }, element("span", {}, name));
  made.addEventListener("click", () => {
    update({ camera: k === state.camera ? null : k });
    [...find("picture").children].forEach((other, i) => other.setAttribute("aria-pressed", String(i === state.camera)));
    if (state.follow) orbit.fly(behindCamera());
  });
  return made;
}

const behindCamera = () => orbit.behind(scene.camera.pose, scene.camera.lens);

async function takeMoment(moment) {
  // the up direction, about which the eye turns, is fixed when the page loads
  if (!frames.length || (data.up === null && moment.up !== null)) return location.reload();
  const before = data.objects.length;
  Object.assign(data, { objects: moment.objects, planes: moment.planes });
  const pictures = moment.cameras.map(({ picture }) => Object.assign(new Image(), { src: `data:image/jpeg;base64,${picture}` }));
  await Promise.all(pictures.map((picture) => picture.decode()));
  showPictures(moment.cameras, pictures);
  scene.take(moment, pictures);
  placeTags();
  listObjects();
  listEvents(moment.events);
  orbit.take(scene.cameraCorners());
  if (state.follow) orbit.set(behindCamera());
  else if (!touched && !orbit.isFlying && (data.objects.length !== before || orbit.losesCameras)) orbit.fly(orbit.home(), 1200);
  const rate = moment.milliseconds > 0 ? [`${(1000 / moment.milliseconds).toFixed(0)} frames/s`] : [];
  const facts = [`frame ${moment.frame}`, ...rate, `${moment.seen} seen / ${moment.objects.length} known`];
  if (data.points.total) facts.push(plural(data.points.total, "point"));
  find("facts").textContent = facts.join("  ·  ");
  find("beat").className = "beat";
  document.body.dataset.frame = moment.frame;
  redraw();
  return undefined;
}

function takeMap(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  Object.assign(data.points, header);
  const { count } = header;
  let at = 4 + length;
  const look = new Uint8Array(buffer, at, 4 * count);
  const steps = new Uint16Array(buffer, (at += 4 * count), 3 * count);
  const label = new Uint16Array(buffer, at + 6 * count, count);
  scene.takeMap({ look, steps, label });
  document.body.dataset.ready = "true";
  redraw();
  return header.number;
}

const connection = { ended: false, lost: false };

function end(text) {
  connection.ended = true;
  find("beat").className = "beat ended";
  find("facts").append(`  ·  ${text}`);
  document.body.dataset.ended = "true";
}

/** Return the content at an address; null without an answer. */
async function asked(address) {
  try {
    return await (await fetch(address)).arrayBuffer();
  } catch {
    return null;
  }
}

/** Request new data repeatedly, but not while the page is hidden; `query` returns the end of the address. */
async function follow(address, take, query = () => "") {
  let number = 0;
  while (!connection.ended) {
    if (document.hidden) {
      await pause(PAUSE / 4);
      continue;
    }
    const answer = await asked(`${address}/${number}${query()}`);
    if (answer === null) return connection.ended || reconnect();
    const before = number;
    number = await take(answer, number);
    if (number === before) await pause(PAUSE / 4); // no new data: the run may be ending
  }
}

/** After a lost connection, wait until it is back or another run answers, and reload the page. */
async function reconnect() {
  if (connection.lost) return;
  connection.lost = true;
  find("beat").className = "beat waiting";
  find("facts").append("  ·  no answer: the program has ended, or the connection is lost");
  document.body.dataset.lost = "true";
  while ((await asked("/")) === null) await pause(PAUSE);
  location.reload();
}

async function main() {
  find("title").textContent = data.title;
  showFrame();
  setUpPhone();
  setUpDividers();
  setUpToolbar(() => tags && tags.layout());
  new More(find("panel"), ".object");
  scene = new LiveScene(new Renderer(canvas), state);
  orbit = new LiveOrbit(canvas, redraw, () => {
    touched = true;
    if (state.follow) update({ follow: false });
  });
  tags = new Tags(find("tags"), state, choose);
  ruler = scene.ruler = new Ruler(state, scene, orbit, () => {
    scene.updateRuler();
    redraw();
  });
  canvas.addEventListener("click", (event) => ruler.active && ruler.click(event.offsetX, event.offsetY));
  find("theme").addEventListener("click", () => update({ theme: state.theme === "dark" ? "light" : "dark" }));
  for (const button of document.querySelectorAll("[data-coloring]"))
    button.addEventListener("click", () => update({ coloring: button.dataset.coloring }));
  for (const button of document.querySelectorAll("[data-layer]"))
    button.addEventListener("click", () => {
      const { layer } = button.dataset;
      update({ layers: { ...state.layers, [layer]: !state.layers[layer] } });
    });
  find("look-home").addEventListener("click", () => {
    touched = false;
    update({ follow: false });
    orbit.fly(orbit.home());
  });
  find("look-down").addEventListener("click", () => {
    touched = true;
    update({ follow: false });
    orbit.fly({ ...orbit.home(), yaw: orbit.place.yaw, pitch: STEEPEST });
  });
  find("look-through").addEventListener("click", () => {
    update({ follow: !state.follow });
    orbit.fly(state.follow && scene.camera ? behindCamera() : orbit.home());
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches("input")) return;
    const action = VIEW_KEYS[event.key.toLowerCase()];
    if (action) action();
    if (event.key === "Escape" && ruler.active) ruler.use(false);
  });
  new ResizeObserver(() => {
    showHint(canvas.clientWidth);
    tags.layout();
    redraw();
  }).observe(canvas);
  state.least = setUpLeast((least) => {
    update({ least });
    scene.colorPoints();
  });
  scene.renderer.fit();
  update({});
  follow("/map", (answer, number) => (answer.byteLength ? takeMap(answer) : number));
  await follow("/moment", async (answer, number) => {
    const moment = JSON.parse(new TextDecoder().decode(answer));
    if (moment.ended) showWarnings(moment.warnings);
    if (moment.ended) end(moment.complete ? "the run is complete, see report.html in its results" : "the run was interrupted");
    if (!moment.number) return number;
    await takeMoment(moment);
    return moment.number;
  }, () => (state.selected === null ? "" : `?measured=${state.selected}`));
}

main().catch((error) => {
  find("notice").textContent = `The 3D view needs a browser with WebGL 2 (${error.message}).`;
  find("view").classList.add("refused");
});
