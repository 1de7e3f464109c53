// The address of the page may name an object: report.html#3.

function openLinked() {
  const object = objectOf.get(Number(location.hash.slice(1)));
  if (!object) return;
  update({ selected: object.label });
  timeline.reveal(object.label);
  approach(object.center, object.size);
}

openLinked();
window.addEventListener("hashchange", openLinked);
