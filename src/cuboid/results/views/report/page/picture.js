// The picture of the frame, with its objects drawn into it; only if a server provides pictures.

class Picture {
  constructor(state) {
    this.state = state;
    this.image = find("frame-picture");
    this.kind = "boxes";
    this.loading = false;
    this.wanted = null;
    this.names = 0; // count of changed names: a picture with new names needs a new address
    if (!data.live || !data.live.pictures) return;
    find("picture").hidden = false;
    showFrame();
    find("picture-kind").replaceChildren(...Object.entries(data.live.kinds).map(([kind, name]) => this.choice(kind, name)));
    this.outline = find("frame-outline");
    this.outline.setAttribute("viewBox", `0 0 ${data.camera.width} ${data.camera.height}`);
    for (const name of ["load", "error"]) this.image.addEventListener(name, () => this.loaded(name));
  }

  choice(kind, name) {
    const button = element("button", { "data-kind": kind, "aria-pressed": String(kind === this.kind) }, name);
    button.addEventListener("click", () => {
      this.kind = kind;
      for (const other of find("picture-kind").children) other.setAttribute("aria-pressed", String(other === button));
      this.update();
    });
    return button;
  }

  /** Request one picture at a time, then the latest wanted one: the slider may be faster than the server. */
  update() {
    if (!data.live || !data.live.pictures || this.state.frame === null) return;
    const again = (this.names ? `&names=${this.names}` : "") + (this.state.least ? `&least=${this.state.least}` : "");
    this.wanted = `${data.live.pictures}/${frames[this.state.frame]}.jpg?what=${this.kind}${again}`;
    if (!this.loading) this.load();
    this.outlineChosen();
  }

  /** The box of the selected object, drawn over the picture. */
  outlineChosen() {
    const object = objectOf.get(this.state.selected);
    const pose = poseOf(this.state.frame);
    const { fx, fy, cx, cy } = data.camera;
    const seen = object ? corners(object).map((corner) => {
      const way = sub(corner, pose.place);
      const depth = dot(way, pose.ahead);
      return [cx + (fx * dot(way, pose.right)) / depth, cy + (fy * dot(way, pose.down)) / depth, depth];
    }) : [];
    const inFront = seen.length && seen.every(([, , depth]) => depth > 0.05);
    const d = inFront ? EDGES.map(([a, b]) => `M${seen[a].slice(0, 2)}L${seen[b].slice(0, 2)}`).join("") : "";
    const looks = [["halo", "currentColor"], ["edge", "#fff"]];
    this.outline.replaceChildren(...looks.map(([kind, stroke]) => shape("path", { class: kind, d, stroke })));
  }

  /** Request the picture again, since names in it have changed. */
  again() {
    this.names += 1;
    this.update();
  }

  load() {
    this.loading = true;
    this.asked = this.wanted;
    this.image.src = this.asked;
  }

  loaded(how) {
    this.loading = false;
    find("picture-note").textContent = how === "load" ? "" : "The picture of this frame cannot be loaded: is 'cuboid view' still running?";
    if (this.wanted !== this.asked) this.load();
  }
}
