// The trend of several campaigns: figures and parameters with their intervals, one plot per unit, series shown one by one or together.
"use strict";
(() => {
  const { look, element, chip } = mjsim, { svg, ticks } = mjsim.plot;
  const data = mjsim.read("mjsim-numbers");
  const dates = data.campaigns.every((c) => c.date);
  const place = data.campaigns.map((c, i) => dates ? Date.parse(c.date) / 864e5 : i);
  const span = Math.max(place[place.length - 1] - place[0], 1e-6), view = [place[0] - 0.08 * span, place[place.length - 1] + 0.08 * span];
  const colours = ["#222222", "#d9480f", "#0072b2", "#007a5a", "#b3007d", "#8a6d00", "#5b3fb5"], dashes = [undefined, "6 3", "2 2"];
  // two significant digits of half the interval, as mjsim/digits.py
  const short = (s, i) => {
    const half = s.lows[i] === null || s.highs[i] === null ? 0 : (s.highs[i] - s.lows[i]) / 2;
    return half > 0 ? mjsim.fixed(s.values[i], Math.max(0, 1 - Number(half.toExponential(1).split("e")[1]))) : String(Number(s.values[i].toPrecision(4)));
  };
  for (const group of document.querySelectorAll("[data-group]")) {
    const series = data.series.filter((s) => s.group === group.dataset.group);
    const changed = series.filter((s) => ["grew", "shrank"].includes(s.verdict));
    const shown = new Set((changed.length ? changed : series).slice(0, 4));
    const plots = [...new Set(series.map((s) => s.unit))].map((unit) => {
      const host = element("div", { className: "trend-plot plot" });
      group.append(host);
      return [unit, host];
    });
    const colour = (s) => colours[series.indexOf(s) % 7], dash = (s) => dashes[Math.floor(series.indexOf(s) / 7) % 3];
    const line = (s) => ({
      name: s.name, x: place, y: s.values, colour: colour(s), width: 1.4, dash: dash(s), dots: true,
      text: (i) => [s.name, [data.campaigns[i].name, s.notes[i]].filter(Boolean).join(", "), `${short(s, i)} ${s.unit}`],
    });
    const bars = (s, at) => place.filter((_, i) => s.lows[i] !== null).map((x) => {
      const i = place.indexOf(x), left = at.x(x) - 4, right = at.x(x) + 4, low = at.y(s.lows[i]), high = at.y(s.highs[i]);
      return svg("path", { d: `M${left} ${low}H${right}M${left} ${high}H${right}M${at.x(x)} ${low}V${high}`, stroke: colour(s), "stroke-width": 1.2 });
    });
    const draw = () => plots.forEach(([unit, host]) => {
      const here = series.filter((s) => s.unit === unit && shown.has(s)), all = here.flatMap((s) => [...s.values, ...s.lows, ...s.highs]).filter((v) => v !== null);
      host.hidden = !all.length;
      if (!all.length) { host.replaceChildren(); return; }
      const low = Math.min(...all), high = Math.max(...all), more = 0.08 * (high - low || Math.abs(high) || 1);
      mjsim.plot.draw(host, {
        margins: [14, 14, 30, 84], x: view, y: [low - more, high + more], yTitle: unit || "ratio", yTicks: (a, b) => ticks(a, b, 5),
        xTicks: () => data.campaigns.map((c, i) => [place[i], dates ? c.date : c.name]), lines: here.map(line), under: (at) => here.flatMap((s) => bars(s, at)),
      });
    });
    for (const s of series) {
      const change = (on) => { if (on) shown.add(s); else shown.delete(s); draw(); };
      document.querySelector(`[data-chips="${group.dataset.group}"]`).append(chip(s.name, shown.has(s), change, s.name, colour(s), dash(s)));
    }
    draw();
  }
})();
