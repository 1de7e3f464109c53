// The labels over the boxes: each in its color, none over another.

class Tags {
  constructor(holder, state, chosen) {
    this.holder = holder;
    this.state = state;
    this.tags = data.objects.map((object) => {
      const tag = element("button", { class: "chip tag", "data-label": object.label, tabindex: "-1" }, titleOf(object));
      tag.style.background = object.color;
      tag.style.color = object.ink;
      tag.style.setProperty("--own", object.color);
      tag.addEventListener("click", () => chosen(object.label));
      holder.append(tag);
      return { tag, object, top: add(object.center, scale(axis(object.rotation, 2), object.size[2] / 2)) };
    });
  }

  /** Put each tag above its box; the nearest chooses first, and one that finds no place becomes a dot. */
  place(eye, stateOf) {
    const width = this.holder.clientWidth;
    const height = this.holder.clientHeight;
    const taken = [];
    const seen = this.tags.map((item) => ({ ...item, clip: toClip(eye.clip_world, item.top) }));
    const behind = 1e6; // those that are hidden choose after those that are seen
    const first = ({ object, clip }) =>
      object.label === this.state.selected ? -behind : clip[3] + (stateOf(object) === "seen" ? 0 : behind);
    for (const { tag, object, clip } of seen.sort((a, b) => first(a) - first(b))) {
      const [x, y] = [(clip[0] / clip[3] + 1) * 0.5 * width, (1 - clip[1] / clip[3]) * 0.5 * height];
      const known = stateOf(object);
      const chosen = object.label === this.state.selected;
      const hidden = !this.state.layers.boxes || (known === "unknown" && !chosen);
      tag.hidden = hidden || clip[3] < eye.near || x < 0 || y < 0 || x > width || y > height;
      if (tag.hidden) continue;
      const half = 9 + 4 * String(object.label).length;
      const box = [-8, -26, -44].map((rise) => [x - half, y + rise - 18, x + half, y + rise]).find((wanted) =>
        taken.every(([x0, y0, x1, y1]) => wanted[0] > x1 || wanted[2] < x0 || wanted[1] > y1 || wanted[3] < y0),
      );
      if (box) taken.push(box);
      tag.classList.toggle("dot", !box);
      tag.classList.toggle("faint", known !== "seen");
      tag.classList.toggle("chosen", chosen);
      tag.style.zIndex = String(chosen ? 9999 : Math.max(1, 5000 - Math.round(100 * clip[3])));
      tag.style.transform = `translate(${x.toFixed(1)}px, ${(box ? box[3] : y).toFixed(1)}px) translate(-50%, ${box ? "-100%" : "-50%"})`;
    }
  }
}
