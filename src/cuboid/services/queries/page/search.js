// The search page: the server answers with whole pages, of which this script shows the parts that have changed.

const form = find("search");
let shown = data;

/** The address of the present fields; empty ones, and a probability from 0, are no conditions. */
function addressOfForm() {
  const asked = new URLSearchParams();
  for (const [name, value] of new FormData(form)) {
    const text = value.trim();
    if (text && !(name === "min_probability" && Number(text) === 0)) asked.set(name, text);
  }
  const query = asked.toString();
  return `${location.pathname}${query ? `?${query}` : ""}`;
}

/** The picture of a card that has changed is moved if it is the same: it does not flicker. */
function keepPicture(old, card) {
  const [before, after] = [old.querySelector(".shot img"), card.querySelector(".shot img")];
  if (!before || !after || before.getAttribute("src") !== after.getAttribute("src")) return;
  after.parentNode.className = before.parentNode.className;
  after.replaceWith(before);
}

/** Cards by their text at the server: a card that has not changed stays, with its picture and the focus. */
function replaceCards(list, next) {
  const before = new Map([...list.children].map((card) => [card.dataset.card, card]));
  const cards = [...next.children].map((card) => {
    card.dataset.text = card.innerHTML;
    const old = before.get(card.dataset.card);
    if (old && old.dataset.text === card.dataset.text) return old;
    if (old) keepPicture(old, card);
    else if (before.size) card.classList.add("new");
    return card;
  });
  const focus = document.activeElement;
  const held = focus && list.contains(focus) ? [focus.closest("[data-card]").dataset.card, focus.getAttribute("href")] : null;
  list.replaceChildren(...cards);
  if (held && document.activeElement !== focus) {
    const card = cards.find((one) => one.dataset.card === held[0]);
    const again = card && [...card.querySelectorAll("a")].find((link) => link.getAttribute("href") === held[1]);
    if (again) again.focus();
  }
}

let asking = 0;
/** Ask the server for the present address, and show its answer. */
async function load() {
  const number = ++asking;
  let text = "";
  try {
    const answer = await fetch(location.href, { headers: { Accept: "text/html" } });
    text = await answer.text();
  } catch {
    return showSilence();
  }
  if (number !== asking) return; // a later question is on its way
  const next = new DOMParser().parseFromString(text, "text/html");
  if (!next.getElementById("answer")) return showSilence();
  shown = JSON.parse(next.getElementById("data").textContent);
  for (const id of ["facts", "answer", "further"]) {
    const part = find(id);
    const changed = next.getElementById(id);
    if (part.innerHTML !== changed.innerHTML) part.innerHTML = changed.innerHTML;
    part.className = changed.className;
  }
  replaceCards(find("cards"), next.getElementById("cards"));
}

function showSilence() {
  find("facts").className = "silent";
  find("facts").textContent = shown.running ? "The run has ended, or the server does not answer" : "The server does not answer";
}

let waiting = 0;
/** Load soon: several changes at once are one answer. */
function loadSoon() {
  if (!waiting)
    waiting = setTimeout(() => {
      waiting = 0;
      load();
    }, 250);
}

/** Hear of each change of the map; a lost connection is opened again. */
function listen() {
  const socket = new WebSocket(new URL(shown.socket, location.href.replace(/^http/, "ws")));
  socket.addEventListener("message", loadSoon);
  socket.addEventListener("close", () => setTimeout(() => (listen(), load()), 3000));
}

function markFields() {
  const set = [...form.querySelectorAll(".fields input, .fields select")].filter((field) => {
    const is = field.type === "range" ? Number(field.value) > 0 : field.value !== "";
    field.classList.toggle("set", is);
    return is;
  });
  find("more").querySelector("b").textContent = set.length || "";
  find("more").querySelector("b").hidden = !set.length;
  const least = form.elements.min_probability;
  if (least) least.nextElementSibling.textContent = Number(least.value) ? Number(least.value).toFixed(2) : "any";
}

function ask() {
  markFields();
  const address = addressOfForm();
  if (address !== location.pathname + location.search) history.pushState(null, "", address);
  load();
}

function setUpForm() {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    ask();
  });
  for (const field of form.querySelectorAll(".fields input, .fields select")) field.addEventListener("change", ask);
  form.addEventListener("input", markFields);
  form.elements.q.addEventListener("search", () => form.elements.q.value || ask()); // the cross in the field
  find("more").addEventListener("click", () => {
    const open = find("filters").classList.toggle("open");
    find("more").setAttribute("aria-expanded", String(open));
  });
  window.addEventListener("popstate", () => location.reload());
  document.addEventListener("keydown", (event) => {
    if (event.key !== "/" || event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select")) return;
    event.preventDefault();
    form.elements.q.select();
  });
  markFields();
  for (const card of find("cards").children) card.dataset.text = card.innerHTML;
  if (shown.socket) listen();
  setInterval(() => {
    if (!document.hidden && (shown.every_s || shown.running)) load();
  }, 1000 * (shown.every_s || 2));
}

const isDark = () => document.documentElement.dataset.theme === "dark" || (!document.documentElement.dataset.theme && !matchMedia("(prefers-color-scheme: light)").matches);
find("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = isDark() ? "light" : "dark";
});
// An image that cannot be loaded: the recording is no longer there.
const bare = (image) => image.closest(".shot") && image.closest(".shot").classList.add("bare");
document.addEventListener("error", (event) => event.target.tagName === "IMG" && bare(event.target), true);
for (const image of document.images) if (image.complete && !image.naturalWidth) bare(image);
if (form) setUpForm();
