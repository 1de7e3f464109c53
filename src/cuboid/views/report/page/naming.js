// Where a server keeps them: names of objects, given in their cards.

/** A field for the name of an object; `named` is told when it was kept. */
function nameField(object, named) {
  const note = element("p", { class: "note bad", role: "status", hidden: "" });
  const field = element("input", {
    type: "text", id: "name", maxlength: "100", value: object.name, placeholder: "name it", "aria-label": `Name of object ${object.label}`,
    autocomplete: "off", spellcheck: "false",
  });
  const say = (text) => {
    note.hidden = !text;
    note.textContent = text;
  };
  field.addEventListener("keydown", (event) => {
    event.stopPropagation(); // its letters are no keys of the scene
    if (event.key === "Escape") field.value = object.name;
    if (event.key === "Enter") keep();
    if (event.key === "Escape") field.blur();
  });
  field.addEventListener("change", () => keep());
  let sent = object.name;
  const keep = async () => {
    if (field.value === sent) return undefined; // Enter has sent it already
    sent = field.value;
    const answer = await post(data.live.names, { label: object.label, name: sent });
    if (answer === null || !answer.ok) sent = null; // it can be tried again
    if (answer === null) return say("The name could not be kept: is 'cuboid view' still running?");
    if (!answer.ok) return say(await answer.text());
    Object.assign(object, await answer.json());
    field.value = sent = object.name; // without a name of the user's, the class that a detector saw
    say("");
    return named(object);
  };
  return [element("label", { class: "field" }, "Name", field), note];
}
