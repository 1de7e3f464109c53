// The frames below the picture: which are suggested, which are drawn on, which is shown.

const stops = Array.from({ length: Math.ceil(data.count / data.every) }, (_, i) => i * data.every);

/** The next frame that is suggested or drawn on, in a direction. */
function nextStop(frame, direction) {
  const all = [...new Set([...stops, ...keyframes.frames.map((item) => item.frame)])].sort((a, b) => a - b);
  return direction > 0 ? all.find((stop) => stop > frame) : all.findLast((stop) => stop < frame);
}

class Way {
  constructor() {
    this.slider = find("slider");
    this.slider.max = data.count - 1;
    this.slider.addEventListener("input", () => moveTo(Number(this.slider.value)));
    find("previous").addEventListener("click", () => moveTo(state.frame - 1));
    find("next").addEventListener("click", () => moveTo(state.frame + 1));
    find("previous-stop").addEventListener("click", () => toStop(-1));
    find("next-stop").addEventListener("click", () => toStop(1));
    new ResizeObserver(() => this.update()).observe(find("slide"));
  }

  update() {
    this.slider.value = state.frame;
    find("frame-number").textContent = `${state.frame} / ${data.count - 1}`;
    find("previous").disabled = state.frame === 0;
    find("next").disabled = state.frame === data.count - 1;
    find("previous-stop").disabled = nextStop(state.frame, -1) === undefined;
    find("next-stop").disabled = nextStop(state.frame, 1) === undefined;
    const marks = find("marks");
    const width = find("slide").clientWidth;
    const knob = 8; // half of the slider's knob, which stays inside
    const at = (frame) => knob + ((width - 2 * knob) * frame) / Math.max(1, data.count - 1);
    marks.replaceChildren(
      ...stops.map((stop) => svgElement("circle", { class: "stop", cx: at(stop), cy: 7, r: 2 })),
      ...keyframes.frames.map((item) => {
        const mark = svgElement("circle", { class: "drawn", cx: at(item.frame), cy: 7, r: 4.5 });
        mark.dataset.keyframe = item.frame;
        return mark;
      }),
    );
  }
}
