// Controls of all pages with a scene or a picture: menus, dividers, cues of what is scrolled away.

const PHONE = window.matchMedia("(max-width: 640px)");

/** Move an element into the element with an id, and back: returns a function of whether it is there. */
function mover(moved, id) {
  const home = document.createComment(moved.id);
  moved.before(home);
  return (away) => (away ? find(id).append(moved) : home.after(moved));
}

/** On a phone, elements with `data-phone` are in the element of that id, which leaves room for the scene. */
function setUpPhone() {
  const movers = [...document.querySelectorAll("[data-phone]")].map((one) => mover(one, one.dataset.phone));
  const place = () => movers.forEach((move) => move(PHONE.matches));
  PHONE.addEventListener("change", place);
  place();
}

/** Room for the picture of the camera: exactly as wide and high as it is. */
function showFrame() {
  const { width, height } = data.camera;
  find("scene").classList.add("with-picture", width < height ? "tall" : "wide");
  find("scene").style.setProperty("--aspect", (width / height).toFixed(4));
}

/** A button that opens a menu; a click elsewhere, or Escape, closes it. */
function setUpMenu(button) {
  const menu = find(button.getAttribute("aria-controls"));
  const open = (is) => {
    menu.hidden = !is;
    button.setAttribute("aria-expanded", String(is));
  };
  button.addEventListener("click", () => open(menu.hidden));
  document.addEventListener("pointerdown", (event) => {
    if (!menu.contains(event.target) && !button.contains(event.target)) open(false);
  });
  button.closest(".menu").addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || menu.hidden) return;
    event.stopPropagation(); // it closes the menu alone
    open(false);
    button.focus();
  });
}

// Width of the scene, pixels, from which the colors of points are in the toolbar; else they are in the menu.
const WIDE_BAR = 580;

/** The toolbar over the scene stays one row: in a narrow scene the colors of points are in its menu. */
function setUpToolbar(changed) {
  setUpMenu(find("show"));
  const move = mover(find("coloring"), "show-coloring");
  const holder = find("view");
  let away = null;
  new ResizeObserver(() => {
    const narrow = holder.clientWidth < WIDE_BAR;
    if (narrow === away) return;
    move((away = narrow));
    changed();
  }).observe(holder);
}

/** Shortcuts of the buttons over the scene. */
const VIEW_KEYS = {
  m: () => find("ruler").click(),
  r: () => find("look-home").click(),
  t: () => find("look-down").click(),
  c: () => find("look-through").click(),
  x: () => document.querySelector('[data-layer="cut"]').click(),
};

/** A length that the browser keeps for the next visit; it may have no memory. */
const memory = {
  get(name) {
    try {
      return Number(localStorage.getItem(name)) || null;
    } catch {
      return null;
    }
  },
  set(name, value) {
    try {
      if (value === null) localStorage.removeItem(name);
      else localStorage.setItem(name, String(value));
    } catch {
      // without a memory the divider begins at its first place
    }
  },
};

// Steps of a divider by arrow keys, and with Shift, pixels.
const STEP = 16;
const LONG_STEP = 64;
// A part beside a divider keeps this length, and at most this fraction of the page.
const LEAST_LENGTH = 120;
const MOST_SHARE = 0.7;

/**
 * A divider that a mouse, a finger or arrow keys move; a double click returns it to its first place.
 * It sets the length `data-size` of the page, which is that of the first visible element of `data-resizes`.
 */
class Divider {
  constructor(bar, moved) {
    Object.assign(this, { bar, moved, scene: find("scene") });
    this.upright = bar.classList.contains("upright");
    this.name = `cuboid ${document.body.dataset.page} ${bar.dataset.size}`;
    this.grabbed = null;
    const listen = (name, action) => bar.addEventListener(name, action);
    listen("pointerdown", (event) => this.grab(event));
    listen("pointermove", (event) => this.drag(event));
    listen("lostpointercapture", () => (this.grabbed = null));
    listen("keydown", (event) => this.key(event));
    listen("dblclick", () => this.set(null));
    window.addEventListener("resize", () => this.show(memory.get(this.name)));
    this.show(memory.get(this.name));
  }

  get length() {
    const ids = this.bar.dataset.resizes.split(" ");
    const shown = ids.map((id) => find(id).getBoundingClientRect()).find(({ width, height }) => width && height);
    return shown ? shown[this.upright ? "width" : "height"] : 0;
  }

  get most() {
    return Math.max(LEAST_LENGTH, MOST_SHARE * (this.upright ? this.scene.clientWidth : this.scene.clientHeight));
  }

  /** Pointers and keys that go left or up make the part longer, since it is on the right or below. */
  grab(event) {
    this.bar.setPointerCapture(event.pointerId);
    this.grabbed = { from: this.upright ? event.clientX : event.clientY, length: this.length };
    this.bar.focus({ preventScroll: true });
    event.preventDefault();
  }

  drag(event) {
    if (!this.grabbed) return;
    const { from, length } = this.grabbed;
    this.set(length + from - (this.upright ? event.clientX : event.clientY));
  }

  key(event) {
    const step = event.shiftKey ? LONG_STEP : STEP;
    const [more, less] = this.upright ? ["ArrowLeft", "ArrowRight"] : ["ArrowUp", "ArrowDown"];
    const lengths = { [more]: this.length + step, [less]: this.length - step, Home: LEAST_LENGTH, End: this.most };
    if (!(event.key in lengths)) return;
    event.preventDefault();
    event.stopPropagation(); // arrow keys are also shortcuts of the page
    this.set(lengths[event.key]);
  }

  set(length) {
    memory.set(this.name, length === null ? null : Math.round(clamp(length, LEAST_LENGTH, this.most)));
    this.show(length);
  }

  show(length) {
    const { size } = this.bar.dataset;
    if (length === null) this.scene.style.removeProperty(size);
    else this.scene.style.setProperty(size, `${clamp(length, LEAST_LENGTH, this.most).toFixed(0)}px`);
    const values = { valuenow: this.length, valuemin: LEAST_LENGTH, valuemax: this.most };
    for (const [name, value] of Object.entries(values)) this.bar.setAttribute(`aria-${name}`, value.toFixed(0));
    this.moved();
  }
}

function setUpDividers(moved = () => {}) {
  for (const bar of document.querySelectorAll(".splitter")) new Divider(bar, moved);
}

/** A button at the lower end of a scrolling part that tells how many of its rows are below, and scrolls to them. */
class More {
  constructor(scroller, rows) {
    Object.assign(this, { scroller, rows });
    this.button = element("button", { class: "more", tabindex: "-1", hidden: "" });
    scroller.append(element("div", { class: "more-place" }, this.button));
    this.button.addEventListener("click", () => scroller.scrollBy({ top: 0.8 * scroller.clientHeight, behavior: "smooth" }));
    scroller.addEventListener("scroll", () => this.update(), { passive: true });
    const sizes = new ResizeObserver(() => this.update());
    for (const one of [scroller, ...scroller.children]) sizes.observe(one);
  }

  update() {
    const { bottom } = this.scroller.getBoundingClientRect();
    const cut = [...this.scroller.querySelectorAll(this.rows)].filter((row) => row.getBoundingClientRect().bottom > bottom + 1);
    this.button.hidden = !cut.length;
    this.button.textContent = `${cut.length.toLocaleString("en")} more ↓`;
    this.scroller.classList.toggle("has-more", cut.length > 0);
  }
}
