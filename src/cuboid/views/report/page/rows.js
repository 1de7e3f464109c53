// Objects as rows of a list, and which of them are asked for.

/** A row of the list: picture where there is one, label with name, size, frames in which it is seen or how well it fits a text. */
function objectRow(object, chosen, fit = null) {
  const { picture } = object;
  const shown = picture ? element("img", { class: "thumb", src: picture.address, alt: "", loading: "lazy", decoding: "async" }) : "";
  const row = element(
    "button",
    { class: picture ? "object with-thumb" : "object", "data-label": object.label },
    shown,
    element("span", { class: "who" }, chip(object), element("span", { class: "size" }, sizeOf(object))),
    fit === null
      ? element("span", { class: "seen-count", title: "frames in which it is seen" }, object.frames_seen.toLocaleString("en"))
      : element("span", { class: "seen-count", title: "how well its pictures fit the text, -1 to 1" }, fixed(fit, 3)),
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

/**
 * The search field above a list; `changed` is told the labels that are asked for, null for all.
 * `described` is told the text on Enter, where a server ranks by it, and "" when it is no longer asked for.
 */
class Search {
  constructor(changed, described = null) {
    this.field = find("search");
    const change = (wanted) => {
      if (described) described("");
      changed(wanted);
    };
    this.field.addEventListener("input", () => change(this.wanted()));
    this.field.addEventListener("keydown", (event) => {
      event.stopPropagation(); // its letters are no keys of the scene
      if (event.key === "Enter" && described && this.field.value.trim()) described(this.field.value.trim());
      if (event.key !== "Escape") return;
      this.field.value = "";
      change(null);
    });
    if (!described) return;
    this.field.placeholder = "Name, #label, > 10 cm; text and Enter";
    this.field.title += "; Enter ranks all by how well their pictures fit the text";
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
