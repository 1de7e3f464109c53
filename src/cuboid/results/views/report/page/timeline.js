// The frames in which each object is seen (thick line), or hidden but in the map (thin line).

const ROW = 18;
const TOUCHED_ROW = 44; // on a phone
const BAR = 10;
// Width for labels with names; less on a phone.
const GUTTER = 236;
const NARROW_GUTTER = 168;
const NARROW = 640;
const CHIP_FONT = "700 11px Inter, system-ui, sans-serif";
const EDGE = 26;
const AXIS = 20;
const THUMB = 8;
// Signs of events: an arrow, a cross, a plus, and an arrow back, in a square of 6 by 6 around the middle.
const SIGNS = {
  moved: "M-3 0H3M0.5 -2.5L3 0L0.5 2.5",
  gone: "M-2.5 -2.5L2.5 2.5M-2.5 2.5L2.5 -2.5",
  appeared: "M-3 0H3M0 -3V3",
  back: "M3 0H-3M-0.5 -2.5L-3 0L-0.5 2.5",
};

const measure = document.createElement("canvas").getContext("2d");

/** A text shortened to a width in pixels, and its final width. */
function fitted(text, room) {
  if (!measure) return [text, room];
  measure.font = CHIP_FONT;
  const wide = (part) => measure.measureText(part).width;
  if (wide(text) <= room) return [text, wide(text)];
  let length = text.length - 1;
  while (length > 1 && wide(`${text.slice(0, length)}…`) > room) length--;
  const cut = `${text.slice(0, length).trimEnd()}…`;
  return [cut, wide(cut)];
}

/** A round step (1, 2 or 5 times a power of ten) that gives at most `most` ticks. */
function tickStep(length, most) {
  const rough = Math.max(1, length / Math.max(1, most));
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= rough);
}

class Timeline {
  constructor(state, chosen, moved) {
    this.state = state;
    this.plot = find("plot");
    this.axis = find("axis");
    this.slider = find("slider");
    this.first = frames.length ? frames[0] : 0;
    this.last = Math.max(this.first + 1, frames.length ? frames[frames.length - 1] : 1);
    this.slider.max = String(Math.max(0, frames.length - 1));
    this.slider.addEventListener("input", () => moved(Number(this.slider.value)));
    this.plot.addEventListener("click", (event) => {
      const sign = event.target.closest("[data-event]");
      if (sign) moved(frames.indexOf(Number(sign.dataset.frame)));
      const row = event.target.closest("[data-row]");
      const label = row && Number(row.dataset.row);
      if (row && !(sign && this.state.selected === label)) chosen(label); // a click on a sign keeps its object selected
    });
    this.scrub(moved);
    this.legend();
    PHONE.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(find("rows"));
  }

  /** The meaning of lines and signs; only of those that the plot has. */
  legend() {
    const bar = (y, height, rest = {}) => shape("rect", { x: 0, y, width: 22, height, fill: "currentColor", stroke: "none", ...rest });
    const sign = (event) => shape("g", { class: "event", transform: "translate(11 6)" }, shape("circle", { r: 6 }), shape("path", { d: SIGNS[event] }));
    const events = Object.keys(SIGNS).filter((event) => happened.some((one) => one.event === event));
    const { skipped } = data.run.frames;
    const lines = [
      ["seen", bar(1, BAR, { rx: 2 })],
      ["hidden, still in the map", bar(5, 2, { class: "known" })],
      ...(skipped.length ? [["skipped frame", shape("rect", { class: "skipped", x: 10, y: 3, width: 2, height: 6, stroke: "none" })]] : []),
      ...events.map((event) => [event, sign(event)]),
    ];
    find("legend").replaceChildren(...lines.map(([text, mark]) => element("span", {}, shape("svg", { "aria-hidden": "true" }, mark), text)));
  }

  /** A pointer on the axis moves through the frames, like the slider. */
  scrub(moved) {
    const move = (event) => {
      const share = (event.offsetX - this.gutter) / (this.width - this.gutter - EDGE);
      const frame = this.first + share * (this.last - this.first);
      const later = frames.findIndex((used) => used >= frame);
      moved(later < 0 ? frames.length - 1 : later);
    };
    this.axis.addEventListener("pointerdown", (event) => {
      this.axis.setPointerCapture(event.pointerId);
      move(event);
    });
    this.axis.addEventListener("pointermove", (event) => this.axis.hasPointerCapture(event.pointerId) && move(event));
  }

  /** Place of a frame on the plot, pixels. */
  x(frame) {
    return this.gutter + ((frame - this.first) / (this.last - this.first)) * (this.width - this.gutter - EDGE);
  }

  draw() {
    this.width = find("rows").clientWidth || find("scene").clientWidth; // on a phone, the list may be shown instead
    this.rowHeight = PHONE.matches ? TOUCHED_ROW : ROW;
    this.gutter = this.width < NARROW ? NARROW_GUTTER : GUTTER;
    const rows = isFiltered(this.state) ? wantedObjects(this.state) : [...data.objects, ...data.gone];
    const height = this.rowHeight * rows.length + 6;
    for (const [plot, high] of [[this.plot, height], [this.axis, AXIS]])
      for (const [name, value] of [["width", this.width], ["height", high]]) plot.setAttribute(name, value);
    const room = Math.max(0, find("timeline").clientWidth - this.width);
    find("gutter").style.width = `${this.gutter - THUMB}px`;
    this.slider.style.marginRight = `${room + EDGE - THUMB}px`;
    this.heads = [[0, height], [AXIS - 5, AXIS]].map(([y1, y2]) => shape("line", { class: "head", y1, y2 }));
    const ticks = this.ticks();
    const grid = ticks.map((x) => shape("line", { x1: x, x2: x, y1: 0, y2: height }));
    this.plot.replaceChildren(shape("g", { class: "axis" }, ...grid), ...rows.map((object, i) => this.row(object, i)), this.heads[0]);
    this.axis.replaceChildren(this.numbers(ticks), this.heads[1]);
    this.update();
  }

  ticks() {
    const step = tickStep(this.last - this.first, (this.width - this.gutter) / 80);
    this.tickFrames = [];
    for (let frame = Math.ceil(this.first / step) * step; frame <= this.last; frame += step) this.tickFrames.push(frame);
    return this.tickFrames.map((frame) => this.x(frame));
  }

  numbers(ticks) {
    const group = shape("g", { class: "axis" });
    ticks.forEach((x, i) => {
      group.append(shape("text", { x, y: 12, "text-anchor": "middle" }, String(this.tickFrames[i])));
    });
    group.append(shape("text", { x: 14, y: 12 }, "label"));
    group.append(shape("text", { x: this.gutter - 12, y: 12, "text-anchor": "end" }, "frames seen"));
    for (const { frame, reason } of data.run.frames.skipped) {
      const mark = shape("rect", { class: "skipped", x: this.x(frame) - 1, y: AXIS - 5, width: 2, height: 5 });
      mark.append(shape("title", {}, `frame ${frame}: ${reason}`));
      group.append(mark);
    }
    return group;
  }

  row(object, i) {
    const y = i * this.rowHeight;
    const middle = y + this.rowHeight / 2;
    const gone = !objectOf.has(object.label);
    const group = shape("g", { class: gone ? "row gone" : "row", ...(gone ? {} : { "data-row": object.label }) });
    const narrow = this.gutter === NARROW_GUTTER;
    const survivor = objectOf.get(object.into);
    const none = narrow ? "gone" : "no longer in the map";
    const fate = survivor ? fitted(`is ${titleOf(survivor)}`, narrow ? 60 : 140)[0] : none;
    const count = gone ? fate : object.frames_seen.toLocaleString("en");
    const [text, width] = fitted(titleOf(object), this.gutter - (gone && !narrow ? 160 : 84));
    group.append(
      shape("rect", { class: "ground", x: 0, y, width: this.width, height: this.rowHeight }),
      shape("rect", { x: 12, y: middle - 7, width: width + 12, height: 14, rx: 4, fill: object.color }),
      shape("text", { class: "name", x: 18, y: middle + 4, fill: object.ink }, text, shape("title", {}, titleOf(object))),
      shape("text", { class: "count", x: this.gutter - 12, y: middle + 4, "text-anchor": "end" }, count),
      ...this.bars(object, middle, gone),
      ...happened.filter(({ label }) => label === object.label).map((one) => this.sign(one, object, middle)),
    );
    return group;
  }

  /** The sign of an event; a click goes to its frame. */
  sign(one, object, middle) {
    const place = { transform: `translate(${this.x(one.frame)} ${middle})`, "data-event": one.event, "data-frame": one.frame };
    const title = shape("title", {}, `${titleOf(object)}: ${wordsOf(one)}, reported in frame ${one.frame}`);
    return shape("g", { class: "event", ...place }, shape("circle", { r: 7 }), shape("path", { d: SIGNS[one.event] }), title);
  }

  bars(object, middle, gone) {
    if (!object.spans.length) return [];
    const every = data.run.config.every || 1;
    const fill = object.color;
    const begin = this.x(object.spans[0][0]);
    const end = this.x(gone ? object.spans[object.spans.length - 1][1] : this.last);
    const known = shape("rect", { class: "known", x: begin, y: middle - 1, width: Math.max(1, end - begin), height: 2, fill });
    const seen = object.spans.map(([from, to]) => {
      const x = this.x(from);
      const width = Math.max(1.5, this.x(Math.min(to + every, this.last)) - x);
      const bar = { class: "seen", "data-label": object.label, "data-from": from, "data-to": to, fill };
      const made = shape("rect", { ...bar, x, y: middle - BAR / 2, width, height: BAR, rx: Math.min(2, width / 2) });
      made.append(shape("title", {}, `${titleOf(object)}: frames ${from} to ${to}`));
      return made;
    });
    return [known, ...seen];
  }

  update() {
    const { frame, selected } = this.state;
    for (const row of this.plot.querySelectorAll("[data-row]"))
      row.classList.toggle("chosen", Number(row.dataset.row) === selected);
    find("all-frames").setAttribute("aria-pressed", String(frame === null));
    find("frame-number").textContent = frame === null ? plural(frames.length, "frame") : `frame ${frames[frame]}`;
    this.slider.classList.toggle("idle", frame === null);
    for (const head of this.heads) head.style.display = frame === null ? "none" : "";
    if (frame === null) return;
    const x = this.x(frames[frame]);
    for (const head of this.heads) for (const end of ["x1", "x2"]) head.setAttribute(end, x);
    this.slider.value = String(frame);
  }

  reveal(label) {
    const row = this.plot.querySelector(`[data-row="${label}"]`);
    if (row) row.scrollIntoView({ block: "nearest" });
  }
}
