// The tree of the place: surfaces, what is on them, and what is on and in that.

/** A part of the tree as a list's item; the rows of its objects are put into `rows`. */
function branchItem(branch, chosen, rows, parent = null) {
  const inner = branch.children.map((child) => branchItem(child, chosen, rows, objectOf.get(branch.of)));
  const below = inner.length ? element("ul", {}, ...inner) : "";
  const object = objectOf.get(branch.of);
  if (!object) return element("li", { class: "surface" }, element("h3", {}, surfaceName(branch)), below);
  const row = objectRow(object, chosen);
  if (parent) row.querySelector(".who").prepend(element("span", { class: "how" }, branch.kind));
  rows.push(row);
  return element("li", {}, row, below);
}

/** A surface by its number, as on cards, and its height over the lowest one. */
function surfaceName({ of, height }) {
  if (!of) return "Support unknown";
  const plane = Number(of.split(":")[1]);
  const number = `Surface ${plane + 1}${bearerOf(plane)}`;
  return height ? `${number}, ${fixed(height, 2)} m above the lowest` : number;
}

/** What an object is to others, as on its card: "beside", [their chips and surfaces]. */
function relationLines(object, chosen) {
  const kinds = new Map();
  for (const [kind, to] of object.relations || []) kinds.set(kind, [...(kinds.get(kind) || []), to]);
  return [...kinds].map(([kind, ends]) => [kind[0].toUpperCase() + kind.slice(1), element("span", { class: "ends" }, ...ends.map((to) => endOf(to, chosen)))]);
}

function endOf(to, chosen) {
  const object = objectOf.get(to);
  if (!object) {
    const [what, number] = String(to).split(":");
    if (number === undefined) return `#${to}`;
    const place = Number(number);
    return what === "plane" ? `surface ${place + 1}${bearerOf(place)}` : `${what} ${place + 1}`;
  }
  const link = element("button", { class: "end" }, chip(object));
  link.addEventListener("click", () => chosen(to));
  return link;
}
