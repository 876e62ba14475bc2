// What people see and do: values, controls, pointer and keys.
const close = () => [at(focus.x, frame()) ?? scene.view.x, at(focus.y, frame()) ?? scene.view.y];
const views = [
  picture($(".above"), () => [scene.view.x, scene.view.y], () => scene.view.width, false),
  picture($(".close"), close, () => (2 * scene.close * 560) / 344, true),
];

function tellState(k) {
  const visible = at(focus.visible, k);
  const percent = visible === null ? "gone" : `${Math.round(100 * visible)} % visible`;
  const ago = ((k - end) * scene.dt).toFixed(1);
  const [state, text] = hidden(k) ? ["gap", `${scene.state} for ${seconds(k).toFixed(1)} s`]
    : k < begin ? ["before", `in view, ${percent}`]
      : ["after", `detected again ${ago} s ago, ${percent}`];
  $(".state").dataset.state = state;
  $(".state").textContent = text;
}

const diagnosed = (one, k) => Object.entries(one.diagnostics)
  .map(([name, column]) => [name.replace(/^(weight|probability)_/, ""), at(column, k)])
  .filter(([, value]) => value !== null).map(([name, value]) => `${name} ${fixed(value, 2)}`);

const axes = (one, k) => `${fixed(at(one.major, k), 2)} × ${fixed(at(one.minor, k), 2)}`;

const rows = filters.map((one) => {
  const row = document.createElement("tr");
  row.dataset.filter = one.name;
  row.innerHTML = '<td><label><input type="checkbox" checked><svg viewBox="0 0 28 10">' +
    `<path d="M0 5h28" stroke="${one.colour}" stroke-width="3" fill="none" ` +
    `${one.dashed ? 'stroke-dasharray="6 4"' : ""}/></svg><span></span></label></td>` +
    ["error", "speed", "ellipse-axes", "track", "weights"]
      .map((kind) => `<td class="${kind}"></td>`).join("");
  row.style.setProperty("--colour", one.colour);
  row.querySelector("span").textContent = one.name;
  row.querySelector("input").addEventListener("change", (event) => {
    one.shown = event.target.checked;
    row.classList.toggle("off", !one.shown);
    draw();
  });
  $("tbody").append(row);
  return row;
});

function tellValues(k) {
  rows.forEach((row, n) => {
    const one = filters[n], id = at(one.track_id, k), there = id !== null;
    const tell = (kind, text) => { row.querySelector(`.${kind}`).textContent = text; };
    tell("error", fixed(at(one.error, k), 2));
    tell("speed", fixed(speed(one, k), 2));
    tell("ellipse-axes", there ? axes(one, k) : "–");
    tell("track", there ? `${id}${id === one.followed ? "" : " (another)"}` +
      `${at(one.coasted, k) ? ", coasting" : ""}` : k < begin ? "none yet" : "ended");
    tell("weights", diagnosed(one, k).join(" · ") || "–");
  });
}

function draw() {
  const k = frame(), things = world();
  for (const view of views) view.draw(things);
  chart.draw();
  slider.value = k;
  slider.setAttribute("aria-valuetext", `${fixed(seconds(k), 1)} s since the gap began`);
  const since = `${seconds(k) < 0 ? "−" : "+"}${Math.abs(seconds(k)).toFixed(1)} s`;
  $(".time").textContent = `${since}, frame ${scene.first + k}`;
  tellState(k);
  tellValues(k);
  if (hovered) showTip();
}

function go(k) {
  pause();
  poster = false;
  now = Math.min(Math.max(k, 0), last);
  draw();
}

function pause() {
  playing = false;
  now = frame();
  tellPlaying();
}

function tellPlaying() {
  player.dataset.playing = playing;
  $(".play").setAttribute("aria-label", playing ? "pause" : "play");
}

function play() {
  if (poster || now >= last) now = 0;
  poster = false;
  playing = true;
  tellPlaying();
  draw();
  let before = null;
  requestAnimationFrame(function next(moment) {
    if (!playing) return;
    const passed = before === null ? 0 : Math.min(moment - before, 100) / 1000;
    before = moment;
    now = Math.min(now + (passed * Number($(".speed").value)) / scene.dt, last);
    if (now >= last) pause();
    draw();
    requestAnimationFrame(next);
  });
}

const toggle = () => { if (playing) { pause(); draw(); } else play(); };

/** Place of a pointer in an SVG's own units. */
const place = (svg, event) => {
  const shown = svg.getBoundingClientRect(), own = svg.viewBox.baseVal;
  return [((event.clientX - shown.left) / shown.width) * own.width,
          ((event.clientY - shown.top) / shown.height) * own.height];
};

function told(view, point) {
  const k = frame(), metres = view.from(point);
  const found = filters.filter((one) => one.shown && at(one.x, k) !== null).map((one) => {
    const [px, py] = view.to([at(one.x, k), at(one.y, k)]);
    return { one, away: Math.hypot(px - point[0], py - point[1]) };
  }).filter(({ away }) => away < 12).sort((a, b) => a.away - b.away).map(({ one }) => one);
  if (found.length) {
    const [one, ...others] = found;
    return [`${one.name}, track ${at(one.track_id, k)}`,
            `position ${fixed(at(one.x, k), 2)}, ${fixed(at(one.y, k), 2)} m`,
            `error ${fixed(at(one.error, k), 2)} m`,
            `speed ${fixed(speed(one, k), 2)} m/s`,
            `95 % ellipse ${axes(one, k)} m`,
            diagnosed(one, k).join(" · "),
            ...others.map((other) => `${other.name}: error ${fixed(at(other.error, k), 2)} m`),
    ].filter(Boolean).join("\n");
  }
  return world().objects.filter(({ own }) => inside(corners(own), { x: metres[0], y: metres[1] }))
    .map(({ one }) => `${one.kind} ${one.id}, ${at(one.regime, k)} (truth)\n` +
      `position ${fixed(at(one.x, k), 2)}, ${fixed(at(one.y, k), 2)} m\n` +
      `speed ${fixed(speed(one, k), 2)} m/s, ${Math.round(100 * at(one.visible, k))} % visible`)
    .join("\n\n");
}

function showTip() {
  const { event, tell } = hovered, text = tell(), outer = player.getBoundingClientRect();
  tip.hidden = !text;
  tip.textContent = text;
  // On the side where there is more room, so that what is asked about stays in sight.
  const x = event.clientX - outer.left, y = event.clientY - outer.top;
  const left = x > outer.width / 2 ? x - tip.offsetWidth - 14 : x + 14;
  tip.style.left = `${Math.max(left, 4)}px`;
  tip.style.top = `${Math.max(Math.min(y + 14, outer.height - tip.offsetHeight - 8), 4)}px`;
}

function hoverable(svg, tell) {
  svg.addEventListener("pointermove", (event) => {
    hovered = { event, tell: () => tell(place(svg, event)) };
    showTip();
  });
  svg.addEventListener("pointerleave", () => { hovered = null; tip.hidden = true; });
}

for (const view of views) hoverable(view.svg, (point) => told(view, point));
hoverable(chart.svg, ([px]) => {
  const k = chart.frameAt(px);
  return [`${seconds(k).toFixed(1)} s`, ...filters.filter((one) => one.shown)
    .map((one) => `${one.name} ${fixed(at(one.error, k), 2)} m`)].join("\n");
});
const drag = (event) => { if (event.buttons & 1) go(chart.frameAt(place(chart.svg, event)[0])); };
chart.svg.addEventListener("pointerdown", (event) => {
  chart.svg.setPointerCapture(event.pointerId);
  drag(event);
});
chart.svg.addEventListener("pointermove", drag);
slider.addEventListener("input", () => go(Number(slider.value)));
$(".play").addEventListener("click", toggle);
$(".back").addEventListener("click", () => go(frame() - 1));
$(".forward").addEventListener("click", () => go(frame() + 1));
player.addEventListener("keydown", (event) => {
  const kind = event.composedPath()[0].localName;
  if (event.key === " " && (kind === "section" || event.composedPath()[0] === slider)) toggle();
  else if (kind === "section" && event.key === "ArrowLeft") go(frame() - 1);
  else if (kind === "section" && event.key === "ArrowRight") go(frame() + 1);
  else return;
  event.preventDefault();
});

// Print shows the frame of the still, whatever was looked at.
let kept = null;
addEventListener("beforeprint", () => { pause(); kept = now; now = scene.still; draw(); });
addEventListener("afterprint", () => { now = kept ?? now; draw(); });

slider.max = last;
$(".title").textContent = scene.title;
player.setAttribute("aria-label", `Playback: ${scene.title}`);
$(".above").setAttribute("aria-label", "the scene from above");
$(".close").setAttribute("aria-label", "the hidden object from above, close");
chart.svg.setAttribute("aria-label", "error of each filter over time; its values are in the table");
// A range's thumb keeps within the ends by half of its width, 8 px.
const share = (k) => `calc(8px + ${k / last} * (100% - 16px))`;
$(".scrub .gap").style.left = share(begin);
$(".scrub .gap").style.right = `calc(100% - ${share(Math.min(end, last))})`;
tellPlaying();
draw();
