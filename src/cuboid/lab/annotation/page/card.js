// The panel: the chosen rectangle, or the frame; and all objects.

const TOO_LITTLE = 0.3; // of what shows less of itself, finding it counts neither way
const RENAMING = "rename";

const sizeText = ([x0, y0, x1, y1]) => `${x1 - x0} × ${y1 - y0} at ${x0}, ${y0}`;

function chipOf(id) {
  const { color, ink } = lookOf(id);
  return element("span", { class: "chip", style: `background:${color};color:${ink}` }, String(id));
}

function button(text, title, action, kind = "plain") {
  const made = element("button", { class: kind, title }, text);
  made.addEventListener("click", action);
  return made;
}

class Card {
  constructor() {
    this.place = find("card");
    this.shown = null;
  }

  update() {
    const { selected } = state;
    // A field that is being typed into stays as it is.
    const key = JSON.stringify([state.frame, selected]);
    if (this.place.contains(document.activeElement) && this.shown === key && document.activeElement.matches("input")) {
      this.refresh();
      return;
    }
    this.shown = key;
    if (selected?.kind === "object") this.place.replaceChildren(...this.ofObject(selected.id));
    else if (selected) this.place.replaceChildren(...this.ofIgnored());
    else this.place.replaceChildren(...this.ofFrame());
    this.refresh();
  }

  /** What may change while a field has the focus. */
  refresh() {
    if (state.selected?.kind !== "object") return;
    const box = boxIn(state.frame, state.selected.id);
    find("rect-size").textContent = sizeText(box.rect);
    find("visible-number").textContent = visibleOf(box).toFixed(2);
    find("visible-note").hidden = visibleOf(box) >= TOO_LITTLE;
    find("visible").value = visibleOf(box);
    find("group").checked = isGroup(box.id);
  }

  ofObject(id) {
    const name = element("input", { id: "name", type: "text", "aria-label": "Name", autocomplete: "off", spellcheck: "false" });
    name.value = nameOf(id);
    name.addEventListener("input", () => {
      change(() => (objectOf(id).name = name.value), `${RENAMING} ${id}`);
      update({});
    });
    name.addEventListener("keydown", (event) => ["Enter", "Escape"].includes(event.key) && (event.stopPropagation(), board.svg.focus()));
    const visible = element("input", { id: "visible", type: "range", min: "0", max: "1", step: "0.05" });
    visible.addEventListener("input", () => setVisible(Number(visible.value)));
    const group = element("input", { id: "group", type: "checkbox" });
    group.addEventListener("change", toggleGroup);
    const note = element("p", { id: "visible-note", class: "note" }, "too little: finding it counts neither way");
    return [
      element("header", {}, chipOf(id), name, button("×", "Let go (Esc)", () => select(null), "quiet close")),
      this.others(id),
      element("label", { class: "field" }, "Visible", visible, element("output", { id: "visible-number" })),
      note,
      element("label", { class: "check" }, group, "Group: several things that may as well be one"),
      element("p", { id: "rect-size", class: "note" }),
      element("div", { class: "actions" },
        button("Delete", "Delete this rectangle (Del)", removeChosen),
        button("Ignore instead", "Make it a place that counts neither way", ignoreInstead)),
    ];
  }

  /** A choice of which object this is. */
  others(id) {
    const here = new Set(keyframeAt(state.frame).boxes.map((box) => box.id));
    const choice = element("select", { id: "which", "aria-label": "Which object it is" });
    for (const item of keyframes.objects)
      choice.append(element("option", { value: item.id }, `${item.id}  ${item.name}${here.has(item.id) && item.id !== id ? "  (change places)" : ""}`));
    choice.append(element("option", { value: "new" }, "a new object"));
    choice.value = String(id);
    choice.addEventListener("change", () => {
      let to = Number(choice.value);
      change(() => {
        if (choice.value === "new") to = newObject();
        reassign(state.frame, id, to);
      });
      select({ kind: "object", id: to });
    });
    return element("label", { class: "field" }, "Object", choice);
  }

  ofIgnored() {
    const rect = keyframeAt(state.frame).ignore[state.selected.index];
    return [
      element("header", {}, element("h2", {}, "Ignored place"), button("×", "Let go (Esc)", () => select(null), "quiet close")),
      element("p", { class: "note" }, "What is found here counts neither way."),
      element("p", { class: "note" }, sizeText(rect)),
      element("div", { class: "actions" },
        button("Delete", "Delete this rectangle (Del)", removeChosen),
        button("Object instead", "Make it an object", objectInstead)),
    ];
  }

  ofFrame() {
    const item = keyframeAt(state.frame);
    const parts = [element("header", {}, element("h2", {}, `Frame ${state.frame}`), element("span", { class: item ? "badge on" : "badge" }, item ? "keyframe" : "not drawn on"))];
    if (item && !item.boxes.length) parts.push(element("p", { class: "note" }, "Nothing to be found here: all that is found counts as false."));
    else if (item) parts.push(element("p", { class: "note" }, `${plural(item.boxes.length, "object")}, ${plural(item.ignore?.length ?? 0, "ignored place")}`));
    else parts.push(element("p", { class: "note" }, ghostsIn(state.frame).length ? "Draw, or copy what is dashed (C)." : "Drag over the picture to draw the first object."));
    if (data.files[state.frame]) parts.push(element("p", { class: "note" }, data.files[state.frame]));
    if (data.poseless.includes(state.frame)) parts.push(element("p", { class: "note bad" }, "This frame has no camera pose: a run with the recording's poses skips it, and misses all in it."));
    const actions = element("div", { class: "actions" });
    if (item) actions.append(button("Clear", "Delete all in this frame: no keyframe any more (K)", toggleKeyframe));
    else actions.append(button("Nothing here", "A keyframe with nothing to be found (K)", toggleKeyframe));
    parts.push(actions);
    return parts;
  }
}

function listObjects() {
  const here = new Set((keyframeAt(state.frame)?.boxes ?? []).map((box) => box.id));
  find("object-count").textContent = plural(keyframes.objects.length, "object");
  const rows = keyframes.objects.map((item) => {
    const times = timesDrawn(item.id);
    const chosen = state.armed === item.id || (state.selected?.kind === "object" && state.selected.id === item.id);
    const row = element("button", { class: `object${here.has(item.id) ? "" : " elsewhere"}`, "aria-pressed": String(chosen), "data-object": item.id },
      chipOf(item.id), element("span", { class: "label" }, item.name + (item.group ? "  (group)" : "")), element("span", { class: "seen-count" }, String(times)));
    row.title = here.has(item.id) ? "Choose it" : "The next rectangle is this one";
    row.addEventListener("click", () => chooseObject(item.id));
    const entry = element("li", {}, row);
    if (!times) entry.append(button("×", "Forget this object", () => { change(() => dropObject(item.id)); update({ armed: null }); }, "quiet close"));
    return entry;
  });
  find("objects").replaceChildren(...rows);
  if (!rows.length) find("objects").append(element("li", { class: "empty" }, "none yet"));
}
