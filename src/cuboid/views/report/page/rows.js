// Objects as rows of a list, and which of them are asked for.

/** A row of the list: picture where there is one, label with name, size, frames in which it is seen. */
function objectRow(object, chosen) {
  const { picture } = object;
  const shown = picture ? element("img", { class: "thumb", src: picture.address, alt: "", loading: "lazy", decoding: "async" }) : "";
  const row = element(
    "button",
    { class: picture ? "object with-thumb" : "object", "data-label": object.label },
    shown,
    element("span", { class: "who" }, chip(object), element("span", { class: "size" }, sizeOf(object))),
    element("span", { class: "seen-count", title: "frames in which it is seen" }, object.frames_seen.toLocaleString("en")),
  );
  row.addEventListener("click", () => chosen(object.label));
  return row;
}

/** Conditions of a search: words of a name, "#3" a label, "> 10" or "< 10" centimetres of the longest side. */
function conditionsOf(text) {
  const words = text.toLowerCase().replace(/([<>])\s+/g, "$1").split(/\s+/).filter(Boolean);
  return words.map((word) => {
    const size = word.match(/^([<>])(\d+(?:\.\d+)?)(?:cm)?$/);
    if (size) {
      const metres = Number(size[2]) / 100;
      return ({ size: sides }) => (size[1] === ">" ? Math.max(...sides) >= metres : Math.max(...sides) <= metres);
    }
    if (/^#\d+$/.test(word)) return ({ label }) => `#${label}` === word;
    return ({ label, name }) => String(label) === word || (name || "").toLowerCase().includes(word);
  });
}

/** The search field above a list; `changed` is told the labels that are asked for, null for all. */
class Search {
  constructor(changed) {
    this.field = find("search");
    this.field.addEventListener("input", () => changed(this.wanted()));
    this.field.addEventListener("keydown", (event) => {
      event.stopPropagation(); // its letters are no keys of the scene
      if (event.key !== "Escape") return;
      this.field.value = "";
      changed(null);
    });
  }

  wanted() {
    const conditions = conditionsOf(this.field.value);
    if (!conditions.length) return null;
    return new Set(data.objects.filter((object) => conditions.every((met) => met(object))).map(({ label }) => label));
  }
}

/** How many objects there are, and how many of them are asked for. */
function countOf(wanted) {
  const all = plural(data.objects.length, "object");
  return wanted ? `${wanted.size.toLocaleString("en")} of ${all}` : all;
}

const isWanted = (state, label) => !state.wanted || state.wanted.has(label);
