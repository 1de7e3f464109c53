// Shared by all pages of this program: their data, and functions that make and find elements.

const data = JSON.parse(document.getElementById("data").textContent);

const find = (id) => document.getElementById(id);

/** An element with attributes, and children that are elements or texts. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** The same for an SVG element. */
function shape(name, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Send a document to the program; null if it does not answer. */
async function post(address, content) {
  try {
    return await fetch(address, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(content),
    });
  } catch {
    return null;
  }
}

/** Show warnings above the page until a click hides them. */
function showWarnings(warnings) {
  const banner = find("warnings");
  banner.hidden = !warnings.length;
  banner.querySelector("ul").replaceChildren(...warnings.map((warning) => element("li", {}, warning)));
  banner.querySelector("button").onclick = () => {
    banner.hidden = true;
  };
}

const plural = (count, word) => `${count.toLocaleString("en")} ${word}${count === 1 ? "" : "s"}`;
