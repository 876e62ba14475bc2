/** The errors over time, with a cursor; its scale is that of the filters that are shown. */
const chart = {
  svg: $(".chart"), left: 44, right: 548, top: 30, bottom: 196,
  x: (k) => chart.left + (k / last) * (chart.right - chart.left),
  frameAt(px) {
    const share = (px - chart.left) / (chart.right - chart.left);
    return Math.round(Math.min(Math.max(share, 0), 1) * last);
  },
  draw() {
    const { left, right, top, bottom, x } = chart;
    const shown = filters.filter((one) => one.shown);
    const errors = shown.flatMap((one) => [].concat(one.error)).filter((e) => e !== null);
    const most = Math.max(0.5, ...errors) * 1.05;
    const y = (error) => bottom - (error / most) * (bottom - top);
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((s) => most / s <= 5) ?? 100;
    const [from, to] = [x(begin), x(Math.min(end, last))];
    const parts = [`<rect class="gap-band" x="${from}" y="${top}" width="${to - from}" ` +
                   `height="${bottom - top}"/>`,
                   `<text class="soft" x="${(from + to) / 2}" y="${top - 6}" ` +
                   `text-anchor="middle">${scene.state}</text>`,
                   '<text class="soft" x="10" y="16">error of each filter [m]</text>'];
    for (let n = 0; n * step <= most; n++)
      parts.push(`<path class="grid" d="M${left} ${y(n * step)}H${right}"/>`,
                 `<text class="soft" text-anchor="end" x="${left - 6}" y="${y(n * step) + 4}">` +
                 `${+(n * step).toFixed(1)}</text>`);
    for (let s = Math.ceil(seconds(0)); s <= seconds(last); s++)
      parts.push(`<path class="axis" d="M${x(begin + s / scene.dt)} ${bottom}v4"/>`,
                 `<text class="soft" text-anchor="middle" x="${x(begin + s / scene.dt)}" ` +
                 `y="${bottom + 19}">${s}</text>`);
    parts.push(`<path class="axis" d="M${left} ${bottom}H${right}"/>`,
               `<text class="soft" text-anchor="end" x="${right}" y="${bottom + 40}">` +
               "time since the gap began [s]</text>");
    for (const one of shown) {
      let path = "";
      for (let k = 0; k <= last; k++) {
        const error = at(one.error, k);
        const pen = k && at(one.error, k - 1) !== null && error !== null ? "L" : "M";
        if (error !== null) path += `${pen}${x(k).toFixed(1)} ${y(error).toFixed(1)}`;
      }
      parts.push(`<path class="line" stroke="${one.colour}" ` +
                 `${one.dashed ? 'stroke-dasharray="6 4"' : ""} d="${path}"/>`);
    }
    parts.push(`<path class="cursor" d="M${x(now)} ${top}V${bottom}"/>`);
    for (const one of shown) {
      const error = between(one.error);
      if (error !== null) parts.push(`<circle cx="${x(now)}" cy="${y(error)}" r="4.5" ` +
                                     `fill="${one.colour}" stroke="#fff" stroke-width="1.2"/>`);
    }
    chart.svg.innerHTML = parts.join("");
  },
};
