// Objects as rows of a list; the search and the slider of the probability, which select them.

/**
 * A row of the list: picture if any, label with name, probability, size (with `errors`, how sure it is), and number of
 * frames or similarity to a text.
 */
function objectRow(object, chosen, fit = null, errors = false) {
  const { picture } = object;
  const shown = picture ? element("img", { class: "thumb", src: picture.address, alt: "", loading: "lazy", decoding: "async" }) : "";
  const row = element(
    "button",
    { class: picture ? "object with-thumb" : "object", "data-label": object.label },
    shown,
    element(
      "span",
      { class: "who" },
      element("span", { class: "label" }, chip(object), element("span", { class: "likely", title: "probability that it is one whole object" }, likely(object))),
      element("span", { class: "size" }, sizeOf(object, errors)),
    ),
    fit === null
      ? element("span", { class: "seen-count", title: "frames in which it is seen" }, object.frames_seen.toLocaleString("en"))
      : element("span", { class: "seen-count", title: "similarity of its pictures to the text, -1 to 1" }, fixed(fit, 3)),
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
 * The search field above a list; `changed` gets the matching labels, null for all.
 * If a server ranks objects by a text, `described` gets the text on Enter, and "" when the text is removed.
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
      event.stopPropagation(); // letters typed here are not keyboard shortcuts of the scene
      if (event.key === "Enter" && described && this.field.value.trim()) described(this.field.value.trim());
      if (event.key !== "Escape") return;
      this.field.value = "";
      change(null);
    });
    if (!described) return;
    this.field.placeholder = "Name, #label, > 10 cm; text and Enter";
    this.field.title += "; Enter ranks all objects by the similarity of their pictures to the text";
  }

  wanted() {
    const conditions = conditionsOf(this.field.value);
    if (!conditions.length) return null;
    return new Set(data.objects.filter((object) => conditions.every((met) => met(object))).map(({ label }) => label));
  }
}

/** The slider of the probability; `changed` gets the least probability of the objects that the page shows. */
function setUpLeast(changed) {
  const slider = find("least");
  const show = () => {
    const least = Number(slider.value);
    find("least-value").textContent = fixed(least, 2);
    slider.setAttribute("aria-valuetext", least ? fixed(least, 2) : "all objects");
    return least;
  };
  show(); // a browser may keep the value when it loads the page again
  slider.addEventListener("input", () => changed(show()));
  return Number(slider.value);
}

const isLikely = (state, object) => object.probability >= state.least;

/** Whether an object matches the search and is likely enough. */
const isWanted = (state, object) => isLikely(state, object) && (!state.wanted || state.wanted.has(object.label));

/** The changes of a scene, without those of unlikely objects. */
const changesShown = (state) => changed.filter(({ label }) => !objectOf.has(label) || isLikely(state, objectOf.get(label)));

/** Whether the search or the slider leaves objects out. */
const isFiltered = (state) => state.wanted !== null || state.least > 0;

/** The objects that match the search and are likely enough. */
const wantedObjects = (state) => data.objects.filter((object) => isWanted(state, object));

/** The number of objects, and the number of matches. */
function countOf(state) {
  const all = plural(data.objects.length, "object");
  return isFiltered(state) ? `${wantedObjects(state).length.toLocaleString("en")} of ${all}` : all;
}
