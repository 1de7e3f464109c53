// The tree of the place: surfaces, the objects on them, and the objects on and in those.

/** A part of the tree as an item of a list; the rows of its objects are appended to `rows`. */
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

/** A surface with its number, as on cards, and its height above the lowest surface. */
function surfaceName({ of, height }) {
  if (!of) return "Support unknown";
  const plane = Number(of.split(":")[1]);
  const number = `Surface ${plane + 1}${bearerOf(plane)}`;
  return height ? `${number}, ${fixed(height, 2)} m above the lowest` : number;
}

/** The relations of an object for its card: "beside", [chips of the objects, surfaces]. */
function relationLines(object, chosen) {
  const kinds = new Map();
  for (const { is: kind, to } of object.relations || []) kinds.set(kind, [...(kinds.get(kind) || []), to]);
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
