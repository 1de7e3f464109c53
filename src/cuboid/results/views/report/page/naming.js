// Names of objects, entered in their cards; only if a server can store them.

/** A field for the name of an object; `named` is called after the name was stored. */
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
    event.stopPropagation(); // letters typed here are not keyboard shortcuts of the scene
    if (event.key === "Escape") field.value = object.name;
    if (event.key === "Enter") keep();
    if (event.key === "Escape") field.blur();
  });
  field.addEventListener("change", () => keep());
  let sent = object.name;
  const keep = async () => {
    if (field.value === sent) return undefined; // Enter has already sent it
    sent = field.value;
    const answer = await post(data.live.names, { label: object.label, name: sent });
    if (answer === null || !answer.ok) sent = null; // the user can try again
    if (answer === null) return say("The name could not be stored: is 'cuboid view' still running?");
    if (!answer.ok) return say(await answer.text());
    Object.assign(object, await answer.json());
    field.value = sent = object.name; // without a name from the user, the class from a detector
    say("");
    return named(object);
  };
  return [element("label", { class: "field" }, "Name", field), note];
}
