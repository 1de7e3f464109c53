// When each object is seen (thick), and hidden but known (thin): the paper's figure as a plot.

const ROW = 18;
const GUTTER = 64;
const EDGE = 18;

function shape(name, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** A round step (1, 2, 5 times a power of ten) that gives at most so many ticks. */
function tickStep(length, most) {
  const rough = Math.max(1, length / Math.max(1, most));
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= rough);
}

class Timeline {
  constructor(state, chosen, moved) {
    this.state = state;
    this.plot = find("plot");
    this.slider = find("slider");
    this.last = Math.max(1, frames.length ? frames[frames.length - 1] : 1);
    this.slider.max = String(Math.max(0, frames.length - 1));
    this.slider.addEventListener("input", () => moved(Number(this.slider.value)));
    this.plot.addEventListener("click", (event) => {
      const row = event.target.closest("[data-row]");
      if (row) chosen(Number(row.dataset.row));
    });
    new ResizeObserver(() => this.draw()).observe(find("rows"));
  }

  /** Place of a frame on the plot, pixels. */
  x(frame) {
    return GUTTER + (frame / this.last) * (this.width - GUTTER - EDGE);
  }

  draw() {
    this.width = find("rows").clientWidth;
    const rows = [...data.objects, ...data.gone];
    const height = ROW * rows.length + 26;
    this.plot.setAttribute("width", this.width);
    this.plot.setAttribute("height", height);
    this.plot.setAttribute("viewBox", `0 0 ${this.width} ${height}`);
    this.head = shape("line", { class: "head", y1: 0, y2: height - 18 });
    const below = this.axis(height - 18);
    this.plot.replaceChildren(below, ...rows.map((object, i) => this.row(object, i)), this.head);
    this.update();
  }

  axis(bottom) {
    const step = tickStep(this.last, (this.width - GUTTER) / 90);
    const group = shape("g", { class: "axis" });
    for (let frame = 0; frame <= this.last; frame += step) {
      const x = this.x(frame);
      const anchor = x > this.width - 40 ? "end" : "middle";
      group.append(
        shape("line", { x1: x, x2: x, y1: 0, y2: bottom }),
        shape("text", { x: anchor === "end" ? this.width - 4 : x, y: bottom + 13, "text-anchor": anchor }, String(frame)),
      );
    }
    group.append(shape("text", { x: GUTTER - 12, y: bottom + 13, "text-anchor": "end" }, "frame"));
    for (const { frame, reason } of data.run.frames.skipped) {
      const mark = shape("rect", { class: "skipped", x: this.x(frame) - 0.75, y: bottom - 3, width: 1.5, height: 6 });
      mark.append(shape("title", {}, `frame ${frame}: ${reason}`));
      group.append(mark);
    }
    return group;
  }

  row(object, i) {
    const y = i * ROW;
    const every = data.run.config.every || 1;
    const gone = !objectOf.has(object.label);
    const group = shape("g", { class: gone ? "row gone" : "row", ...(gone ? {} : { "data-row": object.label }) });
    const what = !gone ? "" : object.into === null ? "no longer in the map" : `turned out to be #${object.into}`;
    group.append(shape("title", {}, `#${object.label} ${what}`.trim()));
    group.append(shape("rect", { class: "ground", x: 0, y, width: this.width, height: ROW }));
    const size = { y: y + 2, height: ROW - 4, width: 40, rx: 4, x: 12 };
    group.append(shape("rect", { ...size, fill: object.color }));
    group.append(shape("text", { class: "name", x: 32, y: y + 13, fill: object.ink, "text-anchor": "middle" }, `#${object.label}`));
    const known = [object.spans[0], object.spans[object.spans.length - 1]];
    if (known[0]) {
      const end = gone ? known[1][1] : this.last;
      const x = this.x(known[0][0]);
      group.append(shape("rect", { class: "known", x, y: y + ROW / 2 - 1, width: this.x(end) - x, height: 2, fill: object.color }));
    }
    for (const [from, to] of object.spans) {
      const x = this.x(from);
      const width = Math.max(1.5, this.x(Math.min(to + every, this.last)) - x);
      const bar = { class: "seen", "data-label": object.label, "data-from": from, "data-to": to };
      group.append(shape("rect", { ...bar, x, y: y + 4, width, height: ROW - 8, rx: Math.min(2, width / 2), fill: object.color }));
    }
    return group;
  }

  update() {
    const { frame, selected } = this.state;
    for (const row of this.plot.querySelectorAll("[data-row]"))
      row.classList.toggle("chosen", Number(row.dataset.row) === selected);
    this.head.style.display = frame === null ? "none" : "";
    find("all-frames").setAttribute("aria-pressed", String(frame === null));
    find("frame-number").textContent = frame === null ? plural(frames.length, "frame") : `frame ${frames[frame]}`;
    this.slider.classList.toggle("idle", frame === null);
    if (frame === null) return;
    const x = this.x(frames[frame]);
    this.head.setAttribute("x1", x);
    this.head.setAttribute("x2", x);
    this.slider.value = String(frame);
  }

  reveal(label) {
    const row = this.plot.querySelector(`[data-row="${label}"]`);
    if (row) row.scrollIntoView({ block: "nearest" });
  }
}
