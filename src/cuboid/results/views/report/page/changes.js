// Changes of the objects of a scene since the previous visit: a list with pictures of before and after.

const CHANGE_WORDS = { moved: "moved", gone: "gone", new: "new", found: "first seen" };

class Changes {
  constructor(state, chosen, looked) {
    this.state = state;
    this.chosen = chosen;
    this.looked = looked;
    find("changes").hidden = !changed.length;
    document.querySelector('[data-layer="changes"]').hidden = !changed.length;
    const dialog = find("compare");
    dialog.querySelector(".close").addEventListener("click", () => dialog.close());
    dialog.addEventListener("click", (event) => event.target === dialog && dialog.close()); // a click outside the dialog
    this.list();
  }

  list() {
    const { chosen, looked } = this;
    const order = Object.keys(CHANGE_WORDS);
    const sorted = [...changed].sort((a, b) => order.indexOf(a.change) - order.indexOf(b.change) || a.label - b.label);
    this.rows = sorted.map((one) => {
      const row = element("button", { class: "change who", "data-label": one.label }, chip(one), this.words(one));
      row.addEventListener("click", () => {
        if (objectOf.has(one.label) && this.state.selected !== one.label) chosen(one.label);
        looked(one.to || one.from, one.size);
      });
      return row;
    });
    find("changes").querySelector("ul").replaceChildren(...this.rows.map((row, i) => element("li", {}, row, this.pair(sorted[i]))));
  }

  words(one) {
    const far = one.change === "moved" ? ` ${cm(one.metres)} cm` : "";
    const sure = one.change === "moved" ? element("small", {}, ` ${Math.round(100 * one.sure)} % alike`) : "";
    return element("span", { class: `kind ${one.change}` }, CHANGE_WORDS[one.change] + far, sure);
  }

  /** The pictures of before and after; null if the object was absent or not seen. */
  sides(one) {
    const before = one.change === "new" || one.change === "found" ? null : one.before;
    return [["before", before], ["after", one.to && one.after]];
  }

  /** Both pictures in a small size; a click shows them large, side by side. */
  pair(one) {
    const sides = this.sides(one);
    if (!sides.some(([, address]) => address)) return "";
    const shown = sides.map(([when, src]) => (src ? element("img", { src, alt: `#${one.label} ${when}` }) : element("i")));
    const button = element("button", { class: "pair", title: "Before and after, side by side" }, shown[0], "→", shown[1]);
    button.addEventListener("click", () => this.compare(one));
    return button;
  }

  compare(one) {
    const dialog = find("compare");
    find("compare-title").replaceChildren(chip(one), " ", this.words(one));
    dialog.querySelector(".sides").replaceChildren(
      ...this.sides(one).map(([when, src]) => {
        const picture = src ? element("img", { src, alt: `${titleOf(one)} ${when}` }) : element("p", { class: "empty" }, this.absence(one, when));
        return element("figure", {}, picture, element("figcaption", {}, when));
      }),
    );
    dialog.showModal();
  }

  absence(one, when) {
    if (when === "after" && one.change === "gone") return "gone";
    return when === "before" && one.change === "new" ? "not there yet" : "not seen";
  }

  update() {
    const shown = new Set(changesShown(this.state).map(({ label }) => label));
    for (const row of this.rows) {
      const label = Number(row.dataset.label);
      row.setAttribute("aria-pressed", String(label === this.state.selected));
      row.parentElement.hidden = !shown.has(label);
    }
  }
}
