// Pictures of the scene from above.

/** A picture in an SVG: `middle()` [x, y] and `width()` of what is in it, in metres. */
function picture(svg, middle, width, detailed) {
  const { width: across, height: down } = svg.viewBox.baseVal;
  const view = { svg, per: 1, detailed };
  view.to = ([x, y]) => [across / 2 + (x - view.x) * view.per, down / 2 - (y - view.y) * view.per];
  view.from = ([px, py]) => [view.x + (px - across / 2) / view.per,
                             view.y - (py - down / 2) / view.per];
  view.draw = (things) => {
    [view.x, view.y] = middle();
    view.per = across / width();
    svg.innerHTML = [...grid(), ...surroundings(things), ...truth(things), ...estimates(),
                     ...outline(things), ...legend()].join("");
  };
  const points = (list) => list.map((p) => view.to(p).map((v) => v.toFixed(1)).join()).join(" ");
  const polygon = (list, kind) => `<polygon class="${kind}" points="${points(list)}"/>`;
  const line = (a, b, kind) => `<polyline fill="none" class="${kind}" points="${points([a, b])}"/>`;
  const step = detailed ? 2 : 10;

  function grid() {
    const [x0, y1] = view.from([0, 0]), [x1, y0] = view.from([across, down]), found = [];
    for (let x = Math.ceil(x0 / step) * step; x < x1; x += step)
      found.push(line([x, y0], [x, y1], "grid"));
    for (let y = Math.ceil(y0 / step) * step; y < y1; y += step)
      found.push(line([x0, y], [x1, y], "grid"));
    return found;
  }

  function surroundings({ sensor, objects, target }) {
    const others = objects.filter((object) => object !== target);
    const found = others.filter((object) => object.shadow)
      .map((object) => polygon(object.shadow, `shadow${object.hides ? " on" : ""}`));
    for (const { one, own, hides } of others)
      found.push(polygon(corners(own), one.tall ? `tall${hides ? " on" : ""}` : "low"), nose(own));
    for (const [x, y, its] of scene.detections[frame()])
      if (!its) found.push(circle([x, y], detailed ? 4 : 2.5, "other"));
    if (target) found.push(line([sensor.x, sensor.y], [target.own.x, target.own.y],
                                `sight${unseen(frame()) ? " cut" : ""}`));
    for (const { own, one } of others.filter((object) => object.hides)) {
      const [px, py] = view.to([own.x, own.y]);
      found.push(`<text class="on-dark" x="${px}" y="${py + 4}" ` +
                 `text-anchor="middle">${one.kind}</text>`);
    }
    const [px, py] = view.to([sensor.x, sensor.y]);
    const turn = 90 - (sensor.yaw * 180) / Math.PI;
    found.push(`<path class="sensor" transform="translate(${px} ${py}) rotate(${turn})" ` +
               'd="M0-10l7 16-7-4-7 4z"/>',
               `<text x="${px + 12}" y="${py + 5}">sensor</text>`);
    return found;
  }

  function truth({ sensor, target }) {
    if (!target) return [];
    const found = [polygon(corners(target.own), "truth ground"), nose(target.own)];
    for (let k = Math.max(frame() - 6, 0); k <= frame(); k++)
      for (const [x, y, its] of scene.detections[k])
        if (its) found.push(`<g opacity="${1 - (frame() - k) / 7}">` +
                            `${circle([x, y], detailed ? 5 : 3.5, "detection")}</g>`);
    if (!detailed) {
      const [px, py] = view.to([target.own.x, target.own.y]);
      const reach = filters.map((one) => at(one.major, frame()) ?? 0);
      const half = Math.max(...corners(target.own).map(([, y]) => y)) - target.own.y;
      const away = Math.max(half, ...reach) * view.per;
      // On the side away from the sensor, where nothing that hides it stands.
      const to = sensor.y > target.own.y ? py + away + 20 : py - away - 8;
      found.push(`<text x="${px}" y="${to}" text-anchor="middle">` +
                 `${focus.kind} ${scene.focus}</text>`);
    }
    return found;
  }

  function estimates() {
    const found = [];
    for (const one of filters) {
      const k = frame();
      if (!one.shown || at(one.x, k) === null) continue;
      const style = `stroke="${one.colour}"${one.dashed ? ' stroke-dasharray="6 4"' : ""}`;
      const [px, py] = view.to([between(one.x), between(one.y)]);
      const turn = (-angle(one.angle) * 180) / Math.PI;
      found.push(`<ellipse cx="${px}" cy="${py}" rx="${between(one.major) * view.per}" ` +
                 `ry="${between(one.minor) * view.per}" fill="${one.colour}" ` +
                 `fill-opacity="0.05" stroke-opacity="0.6" ${style} ` +
                 `transform="rotate(${turn} ${px} ${py})"/>`);
      found.push(`<polygon class="box" ${style} points="${points(corners(box(one)))}"/>`);
      const trail = [];
      for (let n = Math.max(k - 20, 0); n <= k; n++)
        if (at(one.track_id, n) === at(one.track_id, k)) trail.push([at(one.x, n), at(one.y, n)]);
      trail.push([between(one.x), between(one.y)]);
      found.push(`<polyline class="trail" ${style} points="${points(trail)}"/>`);
      const ahead = view.to([between(one.x) + between(one.vx), between(one.y) + between(one.vy)]);
      found.push(arrow([px, py], ahead, one.colour),
                 `<circle cx="${px}" cy="${py}" r="${detailed ? 5 : 4}" fill="${one.colour}" ` +
                 'stroke="#fff" stroke-width="1.2"/>');
    }
    return found;
  }

  function outline({ target }) {
    return target ? [polygon(corners(target.own), `truth${unseen(frame()) ? " unseen" : ""}`)] : [];
  }

  function legend() {
    const metres = detailed ? 2 : 10, y = down - 18, x = 18, to = x + metres * view.per;
    return [`<path class="scale" d="M${x} ${y - 4}v8M${x} ${y}H${to}m0-4v8"/>`,
            `<text x="${to + 8}" y="${y + 5}">${metres} m</text>`,
            detailed ? '<text class="soft" x="14" y="22">close-up</text>' : ""];
  }

  function nose(own) {
    const cos = Math.cos(own.yaw), sin = Math.sin(own.yaw);
    const inBox = ([a, b]) => [own.x + a * own.length * cos - b * own.width * sin,
                               own.y + a * own.length * sin + b * own.width * cos];
    const corner = [[0.3, 0.36], [0.44, 0], [0.3, -0.36]].map(inBox);
    return `<polyline class="heading" points="${points(corner)}"/>`;
  }

  function circle(point, radius, kind) {
    const [px, py] = view.to(point);
    return `<circle class="${kind}" cx="${px.toFixed(1)}" cy="${py.toFixed(1)}" r="${radius}"/>`;
  }
  return view;
}

function arrow([ax, ay], [bx, by], colour) {
  const length = Math.hypot(bx - ax, by - ay);
  if (length < 7) return ""; // It would be under the dot.
  const [ux, uy] = [(bx - ax) / length, (by - ay) / length];
  const head = [[-7, 4], [0, 0], [-7, -4]]
    .map(([u, v]) => `${bx + u * ux - v * uy},${by + u * uy + v * ux}`).join(" ");
  return `<path d="M${ax} ${ay}L${bx} ${by}" stroke="${colour}" stroke-width="1.6"/>` +
         `<polyline points="${head}" fill="none" stroke="${colour}" stroke-width="1.6"/>`;
}
