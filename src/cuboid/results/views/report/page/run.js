// The second tab: times, skipped frames, settings.

const milliseconds = (value) => (value < 10 ? value.toFixed(2) : value.toFixed(1));

function figure(value, unitName, name) {
  return element("div", { class: "figure" }, element("strong", {}, value, element("small", {}, unitName)), element("span", {}, name));
}

function figures() {
  const { run } = data;
  const whole = run.milliseconds.frame;
  const shown = [];
  if (whole) shown.push(figure((1000 / whole.median).toFixed(1), " / s", "frames, by the median"));
  if (whole) shown.push(figure(milliseconds(whole.median), " ms", "median time of a frame"));
  if (whole) shown.push(figure(milliseconds(whole.p95), " ms", "95 % of frames take less"));
  shown.push(figure(run.frames.used.toLocaleString("en"), ` of ${run.frames.read.toLocaleString("en")}`, "frames used"));
  shown.push(figure(run.seconds.toFixed(1), " s", "whole run"));
  shown.push(figure(run.peak_memory_mb.toFixed(0), " MB", "most memory held"));
  return element("div", { class: "figures" }, ...shown);
}

/** The median as a bar, the 95th percentile as a thin bar behind it. */
function stageRow([stage, { median, p95 }], longest) {
  const wide = (value) => `width:${((100 * value) / longest).toFixed(2)}%`;
  const bars = element("div", { class: "bars" });
  bars.append(element("i", { class: "p95", style: wide(p95) }), element("i", { class: "median", style: wide(median) }));
  return element(
    "tr",
    { "data-stage": stage, ...(stage === "frame" ? { class: "whole" } : {}) },
    element("th", { scope: "row" }, stage === "frame" ? "whole frame" : stage),
    element("td", { class: "number" }, milliseconds(median)),
    element("td", { class: "number" }, milliseconds(p95)),
    element("td", { class: "wide" }, bars),
  );
}

function headRow(...names) {
  const cells = names.map(([name, kind]) => element("th", { scope: "col", class: kind || "" }, name));
  return element("thead", {}, element("tr", {}, ...cells));
}

function stages() {
  const rows = Object.entries(data.run.milliseconds);
  if (!rows.length) return element("p", { class: "empty" }, "No frame was used, so no stage was timed.");
  const longest = Math.max(...rows.map(([, timing]) => timing.p95), 1e-6);
  return element(
    "table",
    { id: "stages" },
    headRow(["Stage"], ["median ms", "number"], ["p95 ms", "number"], [""]),
    element("tbody", {}, ...rows.map((row) => stageRow(row, longest))),
  );
}

function skippedFrames() {
  if (!data.skipped.length) return element("p", { class: "empty" }, "None: all read frames were used.");
  const rows = data.skipped.map(([frame, count, reason]) =>
    element(
      "tr",
      {},
      element("td", { class: "number" }, count.toLocaleString("en")),
      element("td", { class: "number" }, String(frame)),
      element("td", { class: "wide" }, reason),
    ),
  );
  return element(
    "table",
    { id: "skipped" },
    headRow(["Frames", "number"], ["First", "number"], ["Reason"]),
    element("tbody", {}, ...rows),
  );
}

function settings() {
  const { run } = data;
  const flat = ([name, value]) => {
    if (Array.isArray(value)) return [[name, value.join(", ") || "-"]];
    if (value !== null && typeof value === "object") return Object.entries(value).flatMap(flat);
    return [[name, value === null ? "-" : String(value)]];
  };
  const about = [
    ["recording", run.recording],
    ["layout", run.format],
    ["camera poses", run.poses],
    ["threads", String(run.threads)],
    ["version", run.version],
  ];
  const lines = [...about, ...Object.entries(run.config).flatMap(flat)];
  return element("dl", { id: "settings" }, ...lines.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
}

function fillRunTab() {
  const block = (title, content) => element("section", {}, element("h2", {}, title), content);
  find("run").replaceChildren(
    figures(),
    element(
      "div",
      { class: "columns" },
      element("div", {}, block("Time of a frame, by stage", stages()), block("Skipped frames", skippedFrames())),
      block("Settings", settings()),
    ),
  );
}
