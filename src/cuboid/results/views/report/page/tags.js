// The tags above the boxes: each in the color of its label, none covers another tag or a toolbar.

// Distance of a tag above the top of its box, pixels; if the place is taken, the tag is higher.
const RISES = [8, 28, 48, 68, 88, 108];
// A tag that is higher than this above its box has a line to it, pixels.
const LINE_FROM = 20;
// The forms of a tag, the shortest first; the last one has the probability of the object.
const FORMS = {
  short: ({ label }) => `#${label}`,
  full: titleOf,
  likely: (object) => (isFurniture(object) ? titleOf(object) : `${titleOf(object)} ${likely(object)}`),
};
// Gap between two tags, pixels.
const BETWEEN = 2;

const overlap = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

class Tags {
  constructor(holder, state, chosen) {
    this.holder = holder;
    this.state = state;
    this.toolbars = null;
    this.lines = shape("path", {});
    holder.append(shape("svg", { class: "tag-lines", "aria-hidden": "true" }, this.lines));
    this.tags = [...data.objects, ...furniture].map((object) => {
      const kind = isFurniture(object) ? "chip tag furniture" : "chip tag";
      const tag = element("button", { class: kind, "data-label": object.label, tabindex: "-1", title: titleOf(object) });
      tag.style.background = object.color;
      tag.style.color = object.ink;
      if (isFurniture(object)) tag.disabled = true;
      else tag.addEventListener("click", () => chosen(object.label));
      holder.append(tag);
      return { tag, object, top: add(object.center, scale(axis(object.rotation, 2), object.size[2] / 2)) };
    });
    this.measure();
  }

  /** Measure all tags in all forms: once, since it forces a layout of the page. */
  measure() {
    const write = (text) => this.tags.forEach((item) => (item.tag.textContent = text(item.object)));
    for (const { tag } of this.tags) {
      tag.hidden = false;
      tag.classList.remove("dot");
    }
    for (const [name, text] of Object.entries(FORMS)) {
      write(text);
      const sizes = this.tags.map(({ tag }) => [tag.offsetWidth, tag.offsetHeight]);
      this.tags.forEach((item, i) => (item[name] = { text: text(item.object), size: sizes[i] }));
    }
  }

  /** Update the name of an object. */
  rename(object) {
    this.tags.find((item) => item.object === object).tag.title = titleOf(object);
    this.measure();
  }

  /** The places of the toolbars, which no tag covers; computed again after `layout`. */
  obstacles() {
    if (!this.toolbars) {
      const { left, top } = this.holder.getBoundingClientRect();
      const bars = this.holder.parentElement.querySelectorAll(".float.bar > *, .float:not(.bar)");
      this.toolbars = [...bars].map((bar) => bar.getBoundingClientRect()).filter(({ width }) => width);
      this.toolbars = this.toolbars.map((bar) => [bar.left - left, bar.top - top, bar.right - left, bar.bottom - top]);
    }
    return this.toolbars;
  }

  layout() {
    this.toolbars = null;
  }

  /** Show the tags as arranged, with lines from high tags to their boxes. */
  place(eye, stateOf) {
    const shown = this.arrange(eye, stateOf);
    const visible = new Set(shown.map(({ tag }) => tag));
    for (const { tag } of this.tags) tag.hidden = !visible.has(tag);
    for (const item of shown) this.show(item, this.obstacles());
    const high = shown.filter(({ rect, at }) => rect && at[1] - rect[3] > LINE_FROM);
    const line = ({ rect, at }) => `M${((rect[0] + rect[2]) / 2).toFixed(1)} ${rect[3].toFixed(1)}L${at.map((value) => value.toFixed(1))}`;
    this.lines.setAttribute("d", high.map(line).join(""));
  }

  /**
   * Arrange a tag above each box. The nearest box is placed first, all tags without their names; then names are added if
   * there is room, and then probabilities. A tag without a free place, which has no `rect`, becomes a dot.
   */
  arrange(eye, stateOf, forms = ["full", "likely"]) {
    const room = [this.holder.clientWidth, this.holder.clientHeight];
    const shown = this.shown(eye, stateOf, room);
    const taken = [...this.obstacles()];
    const wide = [room[0] - 2, room[1] - 2];
    for (const item of shown) {
      item.form = item.chosen ? item.full : item.short;
      item.rect = this.places(item, item.form, wide).find((rect) => !taken.some((other) => overlap(rect, other)));
      if (!item.rect && item.chosen) [item.rect] = this.places(item, item.form, wide);
      if (item.rect) taken.push(item.rect);
    }
    for (const form of forms)
      for (const item of shown.filter(({ rect }) => rect)) this.lengthen(item, item[form], taken, wide);
    return shown;
  }

  /** Give a tag a longer form at the same height, if no other tag is in the way. */
  lengthen(item, form, taken, wide) {
    const own = item.rect;
    const longer = this.places(item, form, wide).find((rect) =>
      rect[3] === own[3] && !taken.some((other) => other !== own && overlap(rect, other)),
    );
    if (!longer) return;
    taken[taken.indexOf(own)] = longer;
    Object.assign(item, { rect: longer, form });
  }

  /** The tags in the view, in the order of their placing. */
  shown(eye, stateOf, [width, height]) {
    const behind = 1e6; // hidden objects are placed after visible ones, furniture after all objects
    const found = this.tags.map((item) => {
      const clip = toClip(eye.clip_world, item.top);
      const known = stateOf(item.object);
      const chosen = item.object.label === this.state.selected;
      const at = [(clip[0] / clip[3] + 1) * 0.5 * width, (1 - clip[1] / clip[3]) * 0.5 * height];
      const outside = clip[3] < eye.near || at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height;
      const hidden = outside || !this.state.layers[isFurniture(item.object) ? "furniture" : "boxes"] || (known === "unknown" && !chosen);
      const late = isFurniture(item.object) ? 2 : known === "seen" ? 0 : 1;
      const first = chosen ? -behind : clip[3] + late * behind;
      return { ...item, at, known, chosen, first, hidden, depth: clip[3] };
    });
    return found.filter(({ hidden }) => !hidden).sort((a, b) => a.first - b.first);
  }

  /** The possible places of a tag, the best first: left, top, right, bottom. */
  places({ at: [x, y] }, { size: [width, height] }, [right, bottom]) {
    const left = clamp(x - width / 2, 2, Math.max(2, right - width));
    return RISES.map((rise) => y - rise)
      .filter((low) => low - height >= 0 && low <= bottom)
      .map((low) => [left, low - height, left + width + BETWEEN, low + BETWEEN]);
  }

  show({ tag, at, known, chosen, rect, form, depth }, bars) {
    const dot = [at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5];
    tag.hidden = !rect && bars.some((bar) => overlap(dot, bar));
    if (tag.textContent !== form.text) tag.textContent = form.text;
    tag.classList.toggle("dot", !rect);
    tag.classList.toggle("faint", known !== "seen");
    tag.classList.toggle("chosen", chosen);
    tag.style.zIndex = String(chosen ? 9999 : Math.max(1, 5000 - Math.round(100 * depth)));
    const [x, y] = rect || [at[0] - 4.5, at[1] - 4.5];
    tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }
}
