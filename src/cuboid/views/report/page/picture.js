// Where a server gives them: the picture of the frame, with its objects drawn into it.

class Picture {
  constructor(state) {
    this.state = state;
    this.image = find("frame-picture");
    this.kind = "boxes";
    this.loading = false;
    this.wanted = null;
    if (!data.live) return;
    for (const shown of [find("picture"), document.querySelector('[data-size="--picture"]')]) shown.hidden = false;
    find("scene").classList.add("with-picture");
    find("picture-kind").replaceChildren(...Object.entries(data.live.kinds).map(([kind, name]) => this.choice(kind, name)));
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

  /** Ask for one picture at a time, and then for the one that is wanted by then: the slider may be fast. */
  update() {
    if (!data.live || this.state.frame === null) return;
    this.wanted = `${data.live.pictures}/${frames[this.state.frame]}.jpg?what=${this.kind}`;
    if (!this.loading) this.load();
  }

  load() {
    this.loading = true;
    this.asked = this.wanted;
    this.image.src = this.asked;
  }

  loaded(how) {
    this.loading = false;
    find("picture-note").textContent = how === "load" ? "" : "This frame's picture cannot be had: is 'cuboid view' still running?";
    if (this.wanted !== this.asked) this.load();
  }
}
