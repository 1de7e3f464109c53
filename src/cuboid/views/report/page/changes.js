// What became of the objects of a scene since the visit before: a list with pictures of before and after.

const CHANGE_WORDS = { moved: "moved", gone: "gone", new: "new", found: "first seen" };

class Changes {
  constructor(state, chosen, looked) {
    this.state = state;
    this.chosen = chosen;
    this.looked = looked;
    find("changes").hidden = !changed.length;
    document.querySelector('[data-layer="changes"]').hidden = !changed.length;
    this.list();
  }

  list() {
    const { chosen, looked } = this;
    const order = Object.keys(CHANGE_WORDS);
    const sorted = [...changed].sort((a, b) => order.indexOf(a.change) - order.indexOf(b.change) || a.label - b.label);
    this.rows = sorted.map((one) => {
      const row = element("button", { class: "change", "data-label": one.label }, chip(one), this.words(one), this.pictures(one));
      row.addEventListener("click", () => {
        if (objectOf.has(one.label) && this.state.selected !== one.label) chosen(one.label);
        looked(one.to || one.from, one.size);
      });
      return row;
    });
    find("changes").querySelector("ul").replaceChildren(...this.rows.map((row) => element("li", {}, row)));
  }

  words(one) {
    const far = one.change === "moved" ? ` ${cm(one.metres)} cm` : "";
    const sure = one.change === "moved" ? element("small", {}, `${Math.round(100 * one.sure)} % alike`) : "";
    return element("span", { class: `kind ${one.change}` }, CHANGE_WORDS[one.change] + far, sure);
  }

  pictures(one) {
    const shown = (when, src) => (src ? element("img", { src, alt: `#${one.label} ${when}`, title: when }) : element("i"));
    const before = shown("before", one.change === "new" || one.change === "found" ? null : one.before);
    return element("span", { class: "pair" }, before, one.before && one.to ? "→" : "", shown("after", one.to && one.after));
  }

  update() {
    for (const row of this.rows) row.setAttribute("aria-pressed", String(Number(row.dataset.label) === this.state.selected));
  }
}
