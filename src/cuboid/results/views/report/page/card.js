// The list of objects, and the card of the selected object.

class Panel {
  constructor(state, { chosen, moved, wished, named }) {
    this.state = state;
    this.chosen = chosen;
    this.moved = moved;
    this.named = named;
    this.arranged = "label";
    find("arranged").hidden = !data.tree;
    for (const button of document.querySelectorAll("[data-arranged]"))
      button.addEventListener("click", () => this.arrange(button.dataset.arranged));
    this.fits = null; // similarity of each object to the text of the search, by label
    this.wished = wished;
    this.list();
    this.search = new Search((wanted) => wished(wanted), data.live && data.live.text ? (text) => this.rank(text) : null);
    find("search").hidden = !this.rows.length;
  }

  list() {
    this.rows = [];
    const isTree = this.arranged === "place" && !this.fits;
    const items = isTree ? data.tree.map((branch) => branchItem(branch, this.chosen, this.rows)) : this.items();
    find("objects").replaceChildren(...items);
    find("last-column").textContent = this.fits ? "fit" : "frames";
  }

  items() {
    const { fits } = this;
    const objects = fits ? data.objects.filter(({ label }) => fits.has(label)) : data.objects;
    const ordered = fits ? objects.sort((a, b) => fits.get(b.label) - fits.get(a.label)) : objects;
    this.rows = ordered.map((object) => objectRow(object, this.chosen, fits && fits.get(object.label)));
    return this.rows.map((row) => element("li", {}, row));
  }

  /** List the objects by label, or as the tree of the place. */
  arrange(arranged) {
    this.arranged = arranged;
    for (const button of document.querySelectorAll("[data-arranged]"))
      button.setAttribute("aria-pressed", String(button.dataset.arranged === arranged));
    this.list();
    this.update();
  }

  /** Sort the list by the similarity of the objects to a text, which the server computes; without a text by label. */
  async rank(text) {
    if (!text && !this.fits) return;
    this.asked = text;
    const answer = text ? await post(data.live.text, { text }) : null;
    if (this.asked !== text) return; // the user has sent another text meanwhile
    const found = answer && answer.ok ? (await answer.json()).objects : null;
    this.fits = found && new Map(found);
    this.list();
    this.wished(found && new Set(this.fits.keys()));
    if (!text || found) return;
    find("none").textContent = answer ? await answer.text() : "The text could not be sent: is 'cuboid view' still running?";
    find("none").hidden = false;
  }

  /** Show the new name of an object wherever its label appears; its card and the field in it stay. */
  renamed(object) {
    this.list();
    find("card").querySelector(".chip").replaceWith(chip(object));
    find("card").querySelector("dl").replaceWith(this.facts(object));
    this.named(object);
  }

  update() {
    const { selected, frame } = this.state;
    const object = objectOf.get(selected);
    for (const row of this.rows) {
      const label = Number(row.dataset.label);
      row.setAttribute("aria-pressed", String(label === selected));
      row.hidden = !isWanted(this.state, objectOf.get(label));
      row.classList.toggle("hidden-now", frame !== null && stateIn(objectOf.get(label), frames[frame]) !== "seen");
    }
    // Supports of objects that match the search stay visible.
    for (const item of find("objects").querySelectorAll("li")) item.hidden = !item.querySelector(".object:not([hidden])");
    find("object-count").textContent = countOf(this.state);
    find("none").textContent = this.rows.length ? "No object matches." : "No object was found.";
    find("none").hidden = wantedObjects(this.state).length > 0;
    const card = find("card");
    card.hidden = !object;
    if (object && card.dataset.label !== String(selected)) {
      card.replaceChildren(...this.card(object));
      find("panel").scrollTop = 0;
    }
    card.dataset.label = String(selected);
    for (const shot of card.querySelectorAll(".moment"))
      shot.setAttribute("aria-current", String(frame !== null && Number(shot.dataset.frame) === frames[frame]));
  }

  card(object) {
    const close = element("button", { class: "quiet close", title: "Close", "aria-label": "Close" }, "×");
    close.addEventListener("click", () => this.chosen(null));
    const head = element("header", {}, chip(object), element("h2", {}, "Object ", String(object.label)), close);
    const naming = data.live ? nameField(object, (one) => this.renamed(one)) : [];
    return [head, ...naming, ...this.picture(object), ...this.strip(object), this.facts(object)];
  }

  picture(object) {
    if (!object.picture) return [];
    const { frame, address } = object.picture;
    const image = element("img", { src: address, alt: `Object ${object.label} in frame ${frame}` });
    const shown = element("div", { class: "shot" }, image, this.outline(object));
    if (!frames.includes(frame)) return [element("figure", {}, shown)]; // from an earlier recording of the scene
    return [element("figure", {}, shown, element("figcaption", {}, "Best seen in ", this.link(frame)))];
  }

  /** Small pictures of the object through time; a click goes to their frames. */
  strip(object) {
    if (!object.strip || object.strip.length < 2) return [];
    const shots = object.strip.map(({ frame, address }) => {
      const image = element("img", { src: address, alt: `Object ${object.label} in frame ${frame}`, loading: "lazy", decoding: "async" });
      const shot = element("button", { class: "moment", "data-frame": frame, title: `Go to frame ${frame}` }, image, element("span", {}, String(frame)));
      shot.addEventListener("click", () => this.moved(frames.indexOf(frame)));
      return shot;
    });
    return [element("div", { class: "strip", role: "group", "aria-label": "Pictures through time, by frame" }, ...shots)];
  }

  /** The edges of the object's box, drawn over its picture. */
  outline(object) {
    const [width, height] = object.picture.size;
    const d = object.picture.edges.map(([x0, y0, x1, y1]) => `M${x0} ${y0}L${x1} ${y1}`).join("");
    const paths = [["halo", "currentColor"], ["edge", object.color]].map(([kind, stroke]) => shape("path", { class: kind, d, stroke }));
    const view = { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "xMidYMid slice", "aria-hidden": "true" };
    return shape("svg", { class: "outline", ...view }, ...paths);
  }

  /** A button with the number of a frame, which goes to that frame. */
  link(frame) {
    const link = element("button", { class: "link" }, `frame ${frame}`);
    link.addEventListener("click", () => this.moved(frames.indexOf(frame)));
    return link;
  }

  facts(object) {
    const swatch = element("span", { class: "swatch", style: `background:rgb(${object.mean_color})` });
    const share = frames.length ? ` of ${frames.length.toLocaleString("en")} frames` : "";
    const plane = object.plane === null ? "-" : `${object.plane + 1} of ${data.planes.length}${bearerOf(object.plane)}`;
    const lines = [
      ["L × W × H", sizeOf(object, true), " cm"],
      ...(sidesSeen(object) ? [["Sides seen", sidesSeen(object)]] : []),
      ["Position", object.center.map((value) => fixed(value, 2)).join(", "), " m"],
      ["First seen", this.link(object.first_frame)],
      ...(object.spans.length ? [["Confirmed in", this.link(object.spans[0][0])]] : []),
      ["Last seen", this.link(object.last_frame)],
      ["Seen in", object.frames_seen.toLocaleString("en"), share],
      ["Probability", this.meter(object.probability, object.color), likely(object)],
      ["Heat", this.meter(object.heat, object.color), object.heat.toFixed(2)],
      ["Points", object.points.toLocaleString("en"), " ", swatch],
      ...(object.relations ? relationLines(object, this.chosen) : [["Stands on plane", plane]]),
    ];
    lines.unshift(...this.classes(object));
    for (const one of happened.filter(({ label }) => label === object.label))
      lines.push([one.event[0].toUpperCase() + one.event.slice(1), one.metres === null ? "" : `${cm(one.metres)} cm, `, this.link(one.frame)]);
    if (object.merged_labels.length) lines.push(["Former labels", object.merged_labels.map((label) => `#${label}`).join(", ")]);
    return element("dl", {}, ...lines.flatMap(([name, ...values]) => [element("dt", {}, name), element("dd", {}, ...values)]));
  }

  /** The class from a detector, and other possible classes. */
  classes({ name, name_score, names }) {
    const percent = (score) => `${Math.round(100 * score)} %`;
    const others = names.map(([other, score]) => `${other}, ${percent(score)}`).join("; ");
    if (name_score === null) return others ? [["The detector says", others]] : []; // a user gave the name
    return [["The detector says", `${name}, ${percent(name_score)}`], ...(others ? [["or", others]] : [])];
  }

  meter(value, color) {
    const fill = element("span", { style: `width:${(100 * clamp(value, 0, 1)).toFixed(0)}%;background:${color}` });
    return element("span", { class: "meter", "aria-hidden": "true" }, fill);
  }
}
