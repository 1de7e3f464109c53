// The picture with its rectangles: drawing, moving, resizing by mouse.

const GRIP = 7; // so near to a handle or an edge is on it, pixels of the screen
const LEAST = 3; // a drag that is shorter is a click, pixels of the screen
const MOST_ZOOM = 24;
const HANDLES = [["w", 0, 0.5], ["e", 1, 0.5], ["n", 0.5, 0], ["s", 0.5, 1], ["nw", 0, 0], ["ne", 1, 0], ["sw", 0, 1], ["se", 1, 1]];
const CURSORS = { w: "ew", e: "ew", n: "ns", s: "ns", nw: "nwse", se: "nwse", ne: "nesw", sw: "nesw" };

const svgElement = (name, attributes = {}, ...children) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
};

const areaOf = ([x0, y0, x1, y1]) => (x1 - x0) * (y1 - y0);
const roundedRect = (rect) => rect.map(Math.round);

class Board {
  constructor() {
    this.place = find("board");
    this.canvas = find("canvas");
    this.svg = find("drawing");
    this.image = null;
    this.view = { zoom: 1, left: 0, top: 0 };
    this.drag = null;
    this.pointer = null;
    this.fitted = true;
    new ResizeObserver(() => this.fitted ? this.fit() : this.draw()).observe(this.place);
    const listen = (name, action) => this.svg.addEventListener(name, action);
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.move(event));
    listen("pointerup", (event) => this.release(event));
    listen("pointercancel", () => this.cancel());
    listen("pointerleave", () => { this.pointer = null; this.draw(); });
    listen("contextmenu", (event) => event.preventDefault());
    this.svg.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Show the whole picture. */
  fit() {
    const { clientWidth, clientHeight } = this.place;
    const [beside, above, below] = PHONE.matches ? [0, 52, 0] : [24, 52, 44]; // for the buttons and the hint
    const room = [clientWidth - beside, clientHeight - above - below];
    const zoom = Math.max(0.05, Math.min(room[0] / data.width, room[1] / data.height));
    this.view = { zoom, left: (clientWidth - zoom * data.width) / 2, top: above + (room[1] - zoom * data.height) / 2 };
    this.fitted = true;
    this.draw();
  }

  zoomAt(x, y, factor) {
    const { zoom, left, top } = this.view;
    const next = clamp(zoom * factor, 0.05, MOST_ZOOM);
    this.view = { zoom: next, left: x - ((x - left) * next) / zoom, top: y - ((y - top) * next) / zoom };
    this.fitted = false;
    this.draw();
  }

  wheel(event) {
    event.preventDefault();
    this.zoomAt(event.offsetX, event.offsetY, Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)));
  }

  // Places: of the screen, and of the picture.

  toPicture(event) {
    const { left, top } = this.svg.getBoundingClientRect();
    const { zoom } = this.view;
    const x = (event.clientX - left - this.view.left) / zoom;
    const y = (event.clientY - top - this.view.top) / zoom;
    return [clamp(x, 0, data.width), clamp(y, 0, data.height)];
  }

  toScreen([x0, y0, x1, y1]) {
    const { zoom, left, top } = this.view;
    return { x: left + zoom * x0, y: top + zoom * y0, width: zoom * (x1 - x0), height: zoom * (y1 - y0) };
  }

  /** All rectangles of the frame: { kind, id or index, rect }. */
  things() {
    const item = keyframeAt(state.frame);
    if (!item) return [];
    return [
      ...(item.ignore ?? []).map((rect, index) => ({ kind: "ignore", index, rect })),
      ...item.boxes.map((box) => ({ kind: "object", id: box.id, rect: box.rect })),
    ];
  }

  selectedThing() {
    return this.things().find((thing) => isSelected(thing));
  }

  /** The handle of the chosen rectangle at a place. */
  handleAt([x, y]) {
    const chosen = this.selectedThing();
    if (!chosen) return null;
    const reach = GRIP / this.view.zoom;
    const [x0, y0, x1, y1] = chosen.rect;
    if (x < x0 - reach || x > x1 + reach || y < y0 - reach || y > y1 + reach) return null;
    // On small rectangles handles leave a third in the middle for moving.
    const near = (value, edge, size) => Math.abs(value - edge) <= Math.min(reach, Math.max(reach / 2, size / 3));
    const across = near(x, x0, x1 - x0) ? "w" : near(x, x1, x1 - x0) ? "e" : "";
    const down = near(y, y0, y1 - y0) ? "n" : near(y, y1, y1 - y0) ? "s" : "";
    return down + across || null;
  }

  /** What lies at a place, the smallest first; ghosts last. */
  hitsAt([x, y]) {
    const inside = ({ rect: [x0, y0, x1, y1] }) => x >= x0 && x <= x1 && y >= y0 && y <= y1;
    const order = (a, b) => areaOf(a.rect) - areaOf(b.rect);
    const ghosts = ghostsIn(state.frame).map((box) => ({ kind: "ghost", id: box.id, rect: box.rect }));
    return [...this.things().filter(inside).sort(order), ...ghosts.filter(inside).sort(order)];
  }

  // The mouse.

  press(event) {
    if (!this.image || this.drag) return;
    this.svg.setPointerCapture(event.pointerId);
    this.svg.focus({ preventScroll: true });
    const start = this.toPicture(event);
    const base = { start, screen: [event.clientX, event.clientY], moved: false };
    if (event.button !== 0) {
      this.drag = { ...base, kind: "pan", view: { ...this.view } };
      return;
    }
    const chosen = this.selectedThing();
    const handle = event.shiftKey ? null : this.handleAt(start);
    const within = !event.shiftKey && chosen && this.hitsAt(start).some((thing) => isSelected(thing));
    if (handle) this.drag = { ...base, kind: "resize", handle, rect: chosen.rect };
    else if (within) this.drag = { ...base, kind: "move", rect: chosen.rect };
    else this.drag = { ...base, kind: "new", rect: [...start, ...start] };
  }

  move(event) {
    const drag = this.drag;
    this.pointer = this.toPicture(event);
    if (!drag) {
      this.hover();
      this.draw();
      return;
    }
    const far = [event.clientX - drag.screen[0], event.clientY - drag.screen[1]];
    drag.moved ||= Math.hypot(...far) >= LEAST;
    if (!drag.moved) return;
    if (drag.kind === "pan") {
      this.view = { ...drag.view, left: drag.view.left + far[0], top: drag.view.top + far[1] };
      this.fitted = false;
    } else drag.now = this.dragged(drag, this.pointer);
    this.draw();
  }

  /** The rectangle that a drag has made of the one it began with. */
  dragged({ kind, handle, rect, start }, [x, y]) {
    if (kind === "new") return [Math.min(start[0], x), Math.min(start[1], y), Math.max(start[0], x), Math.max(start[1], y)];
    let [x0, y0, x1, y1] = rect;
    let [dx, dy] = [x - start[0], y - start[1]];
    if (kind === "move") {
      dx = clamp(dx, -x0, data.width - x1);
      dy = clamp(dy, -y0, data.height - y1);
      return [x0 + dx, y0 + dy, x1 + dx, y1 + dy];
    }
    if (handle.includes("w")) x0 = clamp(x0 + dx, 0, data.width);
    if (handle.includes("e")) x1 = clamp(x1 + dx, 0, data.width);
    if (handle.includes("n")) y0 = clamp(y0 + dy, 0, data.height);
    if (handle.includes("s")) y1 = clamp(y1 + dy, 0, data.height);
    return [Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)];
  }

  release(event) {
    const drag = this.drag;
    this.drag = null;
    if (!drag || drag.kind === "pan") return;
    if (!drag.moved) this.click(drag.start);
    else if (drag.now) this.finish(drag.kind, roundedRect(drag.now));
    this.pointer = this.toPicture(event);
    this.hover();
    this.draw();
  }

  cancel() {
    const dragging = this.drag !== null;
    this.drag = null;
    this.draw();
    return dragging;
  }

  finish(kind, rect) {
    if (rect[2] - rect[0] < 1 || rect[3] - rect[1] < 1) return;
    if (kind === "new") drawn(rect);
    else change(() => (rectHolder(state.selected).rect = rect));
    update({});
  }

  /** Choose what lies at a place; again, what lies beneath it. */
  click(at) {
    const hits = this.hitsAt(at);
    const now = hits.findIndex((thing) => isSelected(thing));
    const next = hits[(now + 1) % (hits.length || 1)];
    if (next?.kind === "ghost") copyGhost(next.id);
    else select(next ?? null);
  }

  hover() {
    const handle = this.pointer && this.handleAt(this.pointer);
    const over = this.pointer && this.hitsAt(this.pointer).some((thing) => isSelected(thing));
    this.svg.style.cursor = handle ? `${CURSORS[handle]}-resize` : over ? "move" : "crosshair";
  }

  // What is seen.

  show(image) {
    this.image = image;
    this.draw();
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.place;
    this.canvas.width = clientWidth * ratio;
    this.canvas.height = clientHeight * ratio;
    const { zoom, left, top } = this.view;
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.imageSmoothingEnabled = zoom < 3; // pixels, where one looks for an edge
    if (this.image) context.drawImage(this.image, left, top, zoom * data.width, zoom * data.height);
    this.svg.dataset.view = [zoom, left, top].join(" ");
    this.svg.replaceChildren(this.hatching(), ...(this.image ? [...this.guides(), ...this.ghosts(), ...this.rects()] : []));
  }

  hatching() {
    const lines = svgElement("path", { d: "M-2 10 10 -2M4 16 16 4" });
    const pattern = { id: "hatch", width: 12, height: 12, patternUnits: "userSpaceOnUse" };
    return svgElement("defs", {}, svgElement("pattern", pattern, lines));
  }

  /** Lines through the pointer: they tell whether a rectangle begins at the edge of a thing. */
  guides() {
    if (!this.pointer || (this.drag ? this.drag.kind !== "new" : this.svg.style.cursor !== "crosshair")) return [];
    const { x, y } = this.toScreen([...this.pointer, ...this.pointer]);
    const all = this.toScreen([0, 0, data.width, data.height]);
    return [
      svgElement("line", { class: "guide", x1: x, x2: x, y1: all.y, y2: all.y + all.height }),
      svgElement("line", { class: "guide", x1: all.x, x2: all.x + all.width, y1: y, y2: y }),
    ];
  }

  ghosts() {
    return ghostsIn(state.frame).map((box) => {
      const style = `--color:${lookOf(box.id).color}`;
      const group = svgElement("g", { class: "ghost", style, "data-ghost": box.id });
      group.append(svgElement("rect", { class: "line", ...this.toScreen(box.rect) }), this.tag(box.rect, box.id, false));
      return group;
    });
  }

  rects() {
    const shown = this.things().map((thing) => ({ ...thing, chosen: isSelected(thing) }));
    const drag = this.drag;
    if (drag?.now && drag.kind !== "new") shown.find((thing) => thing.chosen).rect = drag.now;
    const order = (thing) => (thing.chosen ? 2 : thing.kind === "ignore" ? 0 : 1);
    shown.sort((a, b) => order(a) - order(b) || areaOf(b.rect) - areaOf(a.rect));
    const groups = shown.map((thing) => this.rectOf(thing));
    if (drag?.now && drag.kind === "new") {
      const id = state.tool === "object" ? state.armed : null;
      const color = state.tool === "ignore" ? "#aaaaaa" : id ? lookOf(id).color : "#ffffff";
      groups.push(svgElement("g", { class: "thing new", style: `--color:${color}` }, ...this.outline(drag.now)));
    }
    return groups;
  }

  outline(rect) {
    const place = this.toScreen(rect);
    return [svgElement("rect", { class: "halo", ...place }), svgElement("rect", { class: "line", ...place })];
  }

  rectOf(thing) {
    const ignored = thing.kind === "ignore";
    const box = ignored ? null : boxIn(state.frame, thing.id);
    const faint = box && visibleOf(box) < TOO_LITTLE;
    const classes = ["thing", thing.kind, thing.chosen && "chosen", faint && "faint"].filter(Boolean).join(" ");
    const style = `--color:${ignored ? "#aaaaaa" : lookOf(thing.id).color}`;
    const group = svgElement("g", { class: classes, style, [ignored ? "data-ignored" : "data-id"]: ignored ? thing.index : thing.id });
    if (ignored) group.append(svgElement("rect", { class: "hatched", ...this.toScreen(thing.rect) }));
    group.append(...this.outline(thing.rect));
    if (!ignored) group.append(this.tag(thing.rect, thing.id, thing.chosen));
    if (thing.chosen) group.append(...this.handles(thing.rect));
    return group;
  }

  handles(rect) {
    const { x, y, width, height } = this.toScreen(rect);
    const shown = Math.min(width, height) < 26 ? HANDLES.slice(4) : HANDLES;
    return shown.map(([, across, down]) =>
      svgElement("rect", { class: "handle", x: x + across * width - 3.5, y: y + down * height - 3.5, width: 7, height: 7, rx: 1.5 }),
    );
  }

  /** The name above a rectangle, or inside where there is no room above. */
  tag(rect, id, whole) {
    const { x, y, width: room } = this.toScreen(rect);
    const name = shortened(`${id}  ${nameOf(id)}`, whole ? Infinity : Math.max(room, 110));
    const text = svgElement("text", { x: 6, y: 13 }, name);
    const width = 12 + textWidth(name);
    const left = clamp(x - 1, 2, Math.max(2, this.place.clientWidth - width - 2));
    const top = y - 20 < 2 ? Math.max(y, 0) + 3 : y - 20;
    const plate = svgElement("rect", { class: "plate", width, height: 18, rx: 4 });
    return svgElement("g", { class: "name", transform: `translate(${left} ${top})`, style: `--ink:${lookOf(id).ink}` }, plate, text);
  }
}

/** A text cut so that it is no wider than so many pixels of the screen. */
function shortened(text, room) {
  let end = text.length;
  while (end > 4 && textWidth(text.slice(0, end)) > room - 12) end--;
  return end < text.length ? `${text.slice(0, end - 1).trimEnd()}…` : text;
}

const textWidth = (() => {
  const context = document.createElement("canvas").getContext("2d");
  context.font = `600 12px ${getComputedStyle(document.body).fontFamily}`;
  return (text) => context.measureText(text).width;
})();
