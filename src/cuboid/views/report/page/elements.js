// What every page of ours needs: its data, and making and finding its elements.

const data = JSON.parse(document.getElementById("data").textContent);

const find = (id) => document.getElementById(id);

/** An element with attributes, and children that are elements or texts. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** The same of an SVG. */
function shape(name, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Send something to the program; null where it does not answer. */
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

/** Show lines about what is likely to be wrong above the page, until they are hidden by a click. */
function showWarnings(warnings) {
  const banner = find("warnings");
  banner.hidden = !warnings.length;
  banner.querySelector("ul").replaceChildren(...warnings.map((warning) => element("li", {}, warning)));
  banner.querySelector("button").onclick = () => {
    banner.hidden = true;
  };
}

const plural = (count, word) => `${count.toLocaleString("en")} ${word}${count === 1 ? "" : "s"}`;
