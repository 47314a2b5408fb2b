// The report of one campaign: steps through the models, polar plots and residuals of the tests.
"use strict";
(() => {
  const { look, fixed, niceStep, element, logTicks, chip } = mjsim, { svg, ticks } = mjsim.plot;
  const data = mjsim.read("mjsim-numbers"), traces = mjsim.read("mjsim-traces");
  const byId = (id) => document.getElementById(id);
  const last = data.models.length - 1;
  const shown = { model: last, division: null, measured: true, simulated: true, former: false, events: true, noise: true, common: true };
  const cards = [];

  // -- data of one test ----------------------------------------------------------------------------------------------
  // the page carries each number less the one before it
  const whole = (steps) => { let sum = 0; return steps.map((d) => d === null ? null : (sum += d)); };
  const unpack = (packed) => {
    const axes = Object.fromEntries(Object.entries(packed.axes).map(([name, steps]) => [name, whole(steps)]));
    const t = { ...packed, axes, phi: whole(packed.phi), measured: whole(packed.measured), models: packed.models.map(whole) };
    const phi = t.phi.map((p) => p / 100), rad = phi.map((p) => p * Math.PI / 180);
    const [a, b, c] = t.centre;
    const centred = (x) => x.map((v, i) => v === null ? null : (v - a * Math.cos(rad[i]) - b * Math.sin(rad[i]) - c) / 1e3);
    const angle = phi.map((p) => t.full ? ((p % 360) + 360) % 360 : p);
    const models = t.models.map(centred);
    const residual = t.models.map((m) => m.map((v, i) => t.measured[i] === null ? null : (t.measured[i] - v) / 1e3));
    return { ...t, phi, angle, measured: centred(t.measured), models, residual };
  };
  const extent = (...lists) => lists.reduce((m, x) => x.reduce((a, v) => v === null ? a : [Math.min(a[0], v), Math.max(a[1], v)], m), [0, 0]);

  // where the axes are commanded to be, and which reversal is nearest
  const places = (t) => {
    const at = t.axes.phi.map((p) => p / 100), rising = at[at.length - 1] > at[0];
    let j = 0;
    const text = t.phi.map((p, i) => {
      while (j < at.length - 2 && (rising ? at[j + 1] < p : at[j + 1] > p)) j++;
      const f = Math.min(1, Math.max(0, (p - at[j]) / (at[j + 1] - at[j] || 1)));
      const q = ["X", "Y", "Z", "A", "C"].map((a) => `${a} ${fixed((t.axes[a][j] * (1 - f) + t.axes[a][j + 1] * f) / 100, 2)}${a < "D" ? "°" : ""}`);
      let near = ["", 1e9];
      for (const [axis, angle] of t.events) {
        const d = Math.abs(t.angle[i] - angle), away = t.full ? Math.min(d, 360 - d) : d;
        if (away < near[1]) near = [axis, away];
      }
      const event = near[0] ? `${near[0]} reverses ${fixed(near[1], 1)}° away` : "no axis reverses";
      return [`${q.slice(0, 3).join("  ")} mm`, q.slice(3).join("  "), event];
    });
    return text;
  };

  // -- plots ---------------------------------------------------------------------------------------------------------
  const division = (t) => {
    if (shown.division) return shown.division;
    const range = extent(t.measured, t.models[data.start], t.models[last]);
    return Math.max(0.1, niceStep(Math.max(-range[0], range[1], 1e-6) / 3.2));
  };
  const at = (radius, degrees) => [radius * Math.cos(degrees * Math.PI / 180), radius * Math.sin(degrees * Math.PI / 180)];
  const polarPlot = (t) => {
    const step = division(t), range = extent(t.measured);
    const inner = Math.min(12, Math.max(5, Math.ceil(-range[0] / step) + 1)), outer = Math.min(12, Math.max(4, Math.ceil(range[1] / step)));
    const rim = (inner + outer) * step;
    const line = (name, values, colour, width, dash) => {
      const spots = values.map((v, i) => v === null ? [null, null] : at(Math.max(0, v + inner * step), t.phi[i]));
      const text = (i) => [name, `${fixed(t.angle[i], 1)}°, ${fixed(values[i], 2)} µm`, ...t.text[i]];
      return { name, x: spots.map((s) => s[0]), y: spots.map((s) => s[1]), colour, width, dash, text };
    };
    const grid = (place) => {
      const ring = (k) => svg("circle", { cx: place.x(0), cy: place.y(0), r: place.x(k * step) - place.x(0), fill: "none", stroke: k === inner ? look.nominal : look.grid, "data-ring": k - inner });
      const spoke = (degrees) => { const [x, y] = at(rim, degrees); return svg("line", { x1: place.x(0), y1: place.y(0), x2: place.x(x), y2: place.y(y), stroke: look.grid }); };
      return [...[...Array(12).keys()].map((i) => spoke(30 * i)), ...[...Array(inner + outer).keys()].map((k) => ring(k + 1))];
    };
    const labels = (place) => {
      const out = [svg("text", { x: place.width - 2, y: place.height - 4, "text-anchor": "end", class: "division" }, `1 div.: ${step} µm`)];
      for (let degrees = 0; degrees < 360; degrees += 30) {
        const [x, y] = at(rim, degrees), [px, py] = [place.x(x) + 17 * Math.cos(degrees * Math.PI / 180), place.y(y) - 14 * Math.sin(degrees * Math.PI / 180) + 4];
        if (px > 0 && px < place.width && py > 0 && py < place.height) out.push(svg("text", { x: px, y: py, "text-anchor": "middle", fill: look.ink }, `${degrees}°`));
      }
      return out;
    };
    const lines = [];
    if (shown.measured) lines.push(line("measured", t.measured, look.measured, 1.5));
    if (shown.former) lines.push(line("previous model", t.models[Math.max(shown.model - 1, 0)], look.former, 1, "5 3"));
    if (shown.simulated) lines.push(line("simulated", t.models[shown.model], look.simulated, 1.2));
    return { margins: [24, 34, 24, 34], x: [-rim, rim], y: [-rim, rim], square: true, lines, under: grid, over: labels };
  };
  const spread = (places, apart) => {
    const out = [];
    for (const p of places) out.push(out.length && p - out[out.length - 1] < apart ? out[out.length - 1] + apart : p);
    return out;
  };
  const angleTicks = (low, high, px) => {
    const least = (high - low) * 40 / px, step = [1, 2, 5, 10, 15, 30, 45, 60, 90].find((s) => s >= least) || 180;
    return [...Array(Math.floor(high / step) - Math.ceil(low / step) + 1).keys()].map((k) => (Math.ceil(low / step) + k) * step).map((v) => [v, String(v)]);
  };
  const residualPlot = (t) => {
    const r = t.residual[shown.model], x = [], y = [], index = [];
    for (let i = 0; i < r.length; i++) {
      if (i && Math.abs(t.angle[i] - t.angle[i - 1]) > 180) { x.push(null); y.push(null); index.push(i); }
      x.push(t.angle[i]); y.push(r[i]); index.push(i);
    }
    const [low, high] = t.full ? [0, 360] : [Math.min(...t.angle), Math.max(...t.angle)];
    const range = extent(...(shown.common ? t.residual.slice(data.start) : []), r, [2.5 * t.noise]), limit = 1.06 * Math.max(-range[0], range[1]);
    const marks = shown.events ? t.events.filter(([, a]) => a >= low && a <= high) : [];
    const under = (place) => {
      const edge = (v) => svg("line", { x1: place.left, x2: place.left + place.w, y1: place.y(v), y2: place.y(v), stroke: look.edge, "stroke-width": 0.8 });
      const band = shown.noise ? [svg("rect", { x: place.left, width: place.w, y: place.y(2 * t.noise), height: place.y(-2 * t.noise) - place.y(2 * t.noise), fill: look.band }), edge(2 * t.noise), edge(-2 * t.noise)] : [];
      const zero = svg("line", { x1: place.left, x2: place.left + place.w, y1: place.y(0), y2: place.y(0), stroke: look.nominal });
      return [...band, zero, ...marks.map(([axis, a]) => svg("line", { x1: place.x(a), x2: place.x(a), y1: place.top, y2: place.top + place.h, stroke: look.axes[axis], "stroke-dasharray": "4 3", "data-axis": axis }))];
    };
    const over = (place) => {
      const there = marks.filter(([, a]) => a >= place.view.x[0] && a <= place.view.x[1]), letters = spread(there.map(([, a]) => place.x(a)), 11);
      return there.map(([axis], i) => svg("text", { x: letters[i], y: place.top - 5, "text-anchor": "middle", "font-weight": 700, fill: look.axes[axis] }, axis));
    };
    const text = (i) => ["residual", `${fixed(x[i], 1)}°, ${fixed(y[i], 2)} µm`, ...t.text[index[i]]];
    return {
      margins: [18, 8, 36, 52], x: [low, high], y: [-limit, limit], xTicks: angleTicks, yTicks: (a, b) => ticks(a, b, 7), xTitle: "angle, °", yTitle: "residual, µm",
      lines: [{ name: "residual", x, y, colour: look.measured, width: 0.9, text }], under, over, byX: true,
    };
  };

  const draw = (card) => {
    card.stale = false;
    const t = card.test, k = card.index, m = data.models[shown.model];
    card.number.textContent = fixed(m.tests_um[k], 2);
    card.number.dataset.json = `/models/${shown.model}/tests_um/${k}`;
    if (!t.text) t.text = places(t);
    mjsim.plot.draw(card.polar, polarPlot(t));
    mjsim.plot.draw(card.residual, residualPlot(t));
  };
  const refresh = () => {
    for (const card of cards) {
      card.stale = true;
      if (card.near && !card.root.hidden) draw(card);
    }
  };

  // -- models --------------------------------------------------------------------------------------------------------
  const drawLadder = () => {
    const values = data.models.map((m) => m.rms_um), log = values.map(Math.log10), noise = Math.log10(data.noise_um), x = [], y = [];
    log.forEach((v, i) => { x.push(i - (i ? 0.5 : 0), i + (i < last ? 0.5 : 0)); y.push(v, v); });
    const noiseLine = (place) => [svg("line", { x1: place.left, x2: place.left + place.w, y1: place.y(noise), y2: place.y(noise), stroke: look.former, "stroke-dasharray": "5 3" })];
    const marks = (place) => {
      const dots = values.map((v, i) => {
        const now = i === shown.model, g = svg("g", { "data-step": i, class: "step" });
        g.append(svg("circle", { cx: place.x(i), cy: place.y(log[i]), r: now ? 7 : 4.5, fill: now ? look.simulated : "#fff", stroke: look.simulated, "stroke-width": 2 }));
        g.append(svg("text", { x: place.x(i), y: place.y(log[i]) - 12, "text-anchor": "middle", "font-weight": now ? 700 : 400 }, `${fixed(v, 2)} µm`));
        g.addEventListener("click", () => step(i));
        return g;
      });
      const beside = place.left + place.w + 6, row = (text, dy) => svg("text", { x: beside, y: place.y(noise) + dy, fill: look.former }, text);
      return [...dots, row("noise floor", 0), row(`${fixed(data.noise_um, 2)} µm`, 13)];
    };
    const narrow = byId("ladder-plot").clientWidth < 130 * values.length;
    mjsim.plot.draw(byId("ladder-plot"), {
      margins: [24, 78, 40, 56], x: [-0.4, last + 0.4], y: [Math.min(...log, noise) - 0.2, Math.max(...log) + 0.15], fixed: true, yTitle: "RMS residual, µm",
      xTicks: () => data.models.map((m, i) => [i, narrow ? String(i + 1) : m.label.startsWith("+") ? m.label : m.label.replace(/ (?=\S*$)/, "\n")]),
      yTicks: (low, high) => logTicks(10 ** low, 10 ** high).map((v) => [Math.log10(v), String(Number(v.toPrecision(1)))]),
      lines: [{ name: "ladder", x, y, colour: look.nominal, width: 1.2 }], under: noiseLine, over: marks,
    });
  };
  const step = (to) => {
    shown.model = Math.min(last, Math.max(0, to));
    const m = data.models[shown.model];
    byId("model").value = shown.model;
    byId("model").setAttribute("aria-valuetext", `${m.label}, ${fixed(m.rms_um, 2)} µm`);
    byId("model-name").textContent = `${shown.model + 1} of ${last + 1}: ${m.label}`;
    byId("model-what").textContent = m.what;
    byId("previous").disabled = shown.model === 0;
    byId("next").disabled = shown.model === last;
    const now = byId("error-now");
    now.textContent = "";
    const value = element("span", { textContent: fixed(m.rms_um, 2) });
    value.dataset.json = `/models/${shown.model}/rms_um`;
    now.append(value, " µm");
    const floor = data.noise_um / 2, top = Math.max(...data.models.map((x) => x.rms_um)), part = (v) => 100 * Math.log(Math.max(v, floor) / floor) / Math.log(top / floor);
    byId("error-ratio").textContent = `${fixed(m.rms_um / data.noise_um, 1)} × noise`;
    byId("error-bar").style.width = `${part(m.rms_um)}%`;
    byId("noise-mark").style.left = `${part(data.noise_um)}%`;
    for (const cell of document.querySelectorAll("[data-model]")) cell.classList.toggle("now", Number(cell.dataset.model) === shown.model);
    drawLadder();
    refresh();
  };

  // -- controls ------------------------------------------------------------------------------------------------------
  const boxes = [];
  traces.forEach((packed, index) => {
    const test = unpack(packed), info = data.tests[index];
    const polar = element("div", { className: "polar plot" }), residual = element("div", { className: "residual-plot plot" }), number = element("strong");
    polar.setAttribute("role", "img");
    polar.setAttribute("aria-label", `${test.name}: polar plot of measured and simulated deviation`);
    residual.setAttribute("role", "img");
    residual.setAttribute("aria-label", `${test.name}: residual over the angle with axis reversals`);
    const root = element("section", { className: "card" }, element("h3", { textContent: test.name }), element("p", { className: "soft", textContent: info.conditions }),
      element("p", { className: "soft" }, "RMS residual ", number, ` µm${info.left_out ? ` · ${info.left_out} samples left out` : ""}`), polar, residual);
    root.dataset.test = test.name;
    byId("cards").append(root);
    const card = { root, polar, residual, number, test, index, near: false, stale: true };
    cards.push(card);
    const label = chip(test.name, true, (on) => { root.hidden = !on; if (on && card.stale) draw(card); }, test.name);
    boxes.push([label.firstChild, card]);
    byId("tests-shown").append(label);
  });
  const showAll = (on) => boxes.forEach(([box, card]) => { box.checked = on; card.root.hidden = !on; });
  byId("tests-all").addEventListener("click", () => showAll(true));
  byId("tests-none").addEventListener("click", () => showAll(false));
  const kinds = [
    ["measured", "measured", look.measured], ["simulated", "simulated", look.simulated], ["former", "previous model", look.former, true],
    ["events", "axis reversals", look.nominal, true], ["noise", "noise band ±2σ", look.edge], ["common", "residual: one scale for all models"],
  ];
  for (const [key, text, ...line] of kinds) byId("traces-shown").append(chip(text, shown[key], (on) => { shown[key] = on; refresh(); }, key, ...line));
  for (const um of [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50]) byId("division").append(element("option", { value: um, textContent: `${um} µm per division` }));
  byId("division").addEventListener("change", (e) => { shown.division = Number(e.target.value) || null; refresh(); });
  byId("reset").addEventListener("click", () => {
    shown.division = null;
    byId("division").value = "";
    for (const card of cards) card.polar.zoomed = card.residual.zoomed = null;
    refresh();
  });
  byId("previous").addEventListener("click", () => step(shown.model - 1));
  byId("next").addEventListener("click", () => step(shown.model + 1));
  byId("model").addEventListener("input", (e) => step(Number(e.target.value)));
  document.addEventListener("keydown", (e) => {
    if (e.altKey || e.ctrlKey || e.metaKey || /^(INPUT|SELECT|TEXTAREA)$/.test(e.target.tagName)) return;
    if (e.key === "ArrowLeft") step(shown.model - 1);
    else if (e.key === "ArrowRight") step(shown.model + 1);
    else return;
    e.preventDefault();
  });
  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const card = cards.find((c) => c.root === entry.target);
      card.near = entry.isIntersecting;
      if (card.near && card.stale && !card.root.hidden) draw(card);
    }
  }, { rootMargin: "300px" });
  step(last);
  cards.forEach((card) => watch.observe(card.root));
})();
