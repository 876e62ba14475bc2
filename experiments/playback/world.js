// The scene (scene.py) that stands beside this script, at a moment. While it plays, what is drawn
// moves smoothly from frame to frame; every number that is shown is that of a frame.
const host = document.currentScript.parentElement;
const scene = JSON.parse(host.querySelector('script[type="application/json"]').textContent);
const root = host.attachShadow({ mode: "open" });
root.append(host.querySelector("template").content.cloneNode(true));
const $ = (selector) => root.querySelector(selector);
const player = $(".player"), slider = $(".slider"), tip = $(".tip");
const [begin, end] = scene.gap, last = scene.frames - 1;
const filters = scene.filters.map((one) => ({ ...one, shown: true }));
const focus = scene.objects.find((one) => one.id === scene.focus);
let now = scene.still; // The frame, with a fraction while it plays.
let playing = false, poster = true, hovered = null;

// Columns: a value, or a list of values by frame with null where there is none.
const at = (column, k) => (Array.isArray(column) ? column[k] : column);
const frame = () => Math.floor(now + 1e-9);
const between = (column) => {
  const k = frame(), a = at(column, k), b = at(column, Math.min(k + 1, last));
  return a === null || b === null ? a : a + (now - k) * (b - a);
};
const angle = (column) => {
  const k = frame(), a = at(column, k), b = at(column, Math.min(k + 1, last));
  if (a === null || b === null) return a;
  return a + (now - k) * Math.atan2(Math.sin(b - a), Math.cos(b - a));
};
const fixed = (value, decimals) =>
  (value === null ? "–" : value.toFixed(decimals).replace("-", "−"));
const speed = (one, k) => {
  const vx = at(one.vx, k), vy = at(one.vy, k);
  return vx === null || vy === null ? null : Math.hypot(vx, vy);
};
const hidden = (k) => k >= begin && k < end;
const unseen = (k) => hidden(k) || at(focus.visible, k) < scene.in_view;
const seconds = (k) => (k - begin) * scene.dt;
const box = (one) => ({ x: between(one.x), y: between(one.y), yaw: angle(one.yaw),
                        length: between(one.length), width: between(one.width) });
const corners = ({ x, y, yaw, length, width }) =>
  [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([a, b]) => {
    const u = (a * length) / 2, v = (b * width) / 2;
    return [x + u * Math.cos(yaw) - v * Math.sin(yaw), y + u * Math.sin(yaw) + v * Math.cos(yaw)];
  });

/** Where the sensor is, and each object with the ground that it hides from the sensor. */
function world() {
  const sensor = { x: between(scene.sensor.x), y: between(scene.sensor.y),
                   yaw: angle(scene.sensor.yaw) };
  const objects = scene.objects.filter((one) => at(one.x, frame()) !== null).map((one) => {
    const own = box(one);
    return { one, own, shadow: one.tall && one !== focus ? shadow(sensor, own) : null };
  });
  const target = objects.find((object) => object.one === focus);
  for (const object of objects)
    object.hides = Boolean(target && object.shadow && inside(object.shadow, target.own));
  return { sensor, objects, target };
}

function shadow(sensor, own) {
  const middle = Math.atan2(own.y - sensor.y, own.x - sensor.x);
  const seen = corners(own).map(([x, y]) => {
    const turn = Math.atan2(y - sensor.y, x - sensor.x) - middle;
    return { x, y, turn: Math.atan2(Math.sin(turn), Math.cos(turn)) };
  }).sort((a, b) => a.turn - b.turn);
  const far = ({ x, y }) => {
    const scale = 1000 / Math.hypot(x - sensor.x, y - sensor.y);
    return [sensor.x + (x - sensor.x) * scale, sensor.y + (y - sensor.y) * scale];
  };
  const [right, left] = [seen[0], seen[3]];
  return [[right.x, right.y], far(right), far(left), [left.x, left.y]];
}

function inside(polygon, { x, y }) {
  return polygon.every(([ax, ay], k) => {
    const [bx, by] = polygon[(k + 1) % polygon.length];
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0;
  });
}
