// The report of one campaign: steps through the models, polar plots and residuals of the tests.
"use strict";
(() => {
  const { look, font, config, fixed, niceStep, plainText, element, logTicks } = mjsim;
  const data = mjsim.read("mjsim-numbers"), traces = mjsim.read("mjsim-traces");
  const byId = (id) => document.getElementById(id);
  const last = data.models.length - 1;
  const shown = { model: last, division: null, measured: true, simulated: true, former: false, events: true, noise: true, common: true };
  const cards = [];

  // -- data of one test ----------------------------------------------------------------------------------------------
  const unpack = (t) => {
    const phi = t.phi.map((p) => p / 100), rad = phi.map((p) => p * Math.PI / 180);
    const centred = (x, c) => x.map((v, i) => v === null ? null : (v - c[0] * Math.cos(rad[i]) - c[1] * Math.sin(rad[i]) - c[2]) / 1e3);
    const angle = phi.map((p) => t.full ? (((p + t.shift) % 360) + 360) % 360 : p + t.shift);
    const models = t.models.map((m, k) => centred(m, t.centre[k + 1]));
    const residual = t.models.map((m) => m.map((v, i) => t.measured[i] === null ? null : (t.measured[i] - v) / 1e3));
    return { ...t, phi, angle, polar: phi.map((p) => p + t.shift), measured: centred(t.measured, t.centre[0]), models, residual };
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
      return `${q.slice(0, 3).join("  ")} mm<br>${q.slice(3).join("  ")}<br>${event}`;
    });
    return text;
  };

  // -- plots ---------------------------------------------------------------------------------------------------------
  const division = (t) => {
    if (shown.division) return shown.division;
    const range = extent(t.measured, t.models[data.start], t.models[last]);
    return Math.max(0.1, niceStep(Math.max(-range[0], range[1], 1e-6) / 3.2));
  };
  const hover = "%{theta:.1f}°, %{r:.2f} µm<br>%{text}<extra>%{fullData.name}</extra>";
  const polarTraces = (t) => {
    const former = Math.max(shown.model - 1, 0), circle = [...Array(121).keys()].map((i) => i * 3);
    const line = (name, r, color, width, visible, dash) => ({
      type: "scatterpolar", mode: "lines", name, theta: t.polar, r, text: t.text, hovertemplate: hover, visible, line: { color, width, dash: dash || "solid" },
    });
    return [
      { type: "scatterpolar", mode: "lines", theta: circle, r: circle.map(() => 0), line: { color: look.nominal, width: 1 }, hoverinfo: "skip", showlegend: false },
      line("measured", t.measured, look.measured, 1.5, shown.measured),
      line("previous model", t.models[former], look.former, 1, shown.former, "dash"),
      line("simulated", t.models[shown.model], look.simulated, 1.2, shown.simulated),
    ];
  };
  const polarLayout = (t) => {
    const step = division(t), range = extent(t.measured), inner = Math.max(5, Math.ceil(-range[0] / step) + 1), outer = Math.max(4, Math.ceil(range[1] / step));
    const rings = [];
    for (let k = -Math.min(inner, 12) + 1; k < Math.min(outer, 12); k++) rings.push(k * step);
    return {
      font, showlegend: false, margin: { l: 34, r: 34, t: 26, b: 34 }, paper_bgcolor: "#fff", hovermode: "closest", dragmode: "zoom",
      annotations: [{ text: `1 div.: ${step} µm`, x: 1, y: -0.06, xref: "paper", yref: "paper", showarrow: false, xanchor: "right", font: { size: 11.5 } }],
      polar: {
        bgcolor: "#fff",
        radialaxis: { range: [-Math.min(inner, 12) * step, Math.min(outer, 12) * step], tickvals: rings, ticktext: rings.map(() => ""), showline: false, ticks: "", gridcolor: look.grid, angle: 45 },
        angularaxis: { direction: "counterclockwise", rotation: 0, dtick: 30, gridcolor: look.grid, linecolor: look.grid, ticks: "" },
      },
    };
  };
  const residualTraces = (t) => {
    const r = t.residual[shown.model], x = [], y = [], text = [];
    for (let i = 0; i < r.length; i++) {
      if (i && Math.abs(t.angle[i] - t.angle[i - 1]) > 180) { x.push(null); y.push(null); text.push(""); }
      x.push(t.angle[i]); y.push(r[i]); text.push(t.text[i]);
    }
    return [{ type: "scatter", mode: "lines", name: "residual", x, y, text, line: { color: look.measured, width: 0.9 }, hovertemplate: "%{x:.1f}°, %{y:.2f} µm<br>%{text}<extra>residual</extra>" }];
  };
  const spread = (angles, apart) => {
    const out = [];
    for (const a of angles) out.push(out.length && a - out[out.length - 1] < apart ? out[out.length - 1] + apart : a);
    return out;
  };
  const niceTurn = (least) => [1, 2, 5, 10, 15, 30, 45, 60, 90].find((s) => s >= least) || 180;
  const residualLayout = (t, width) => {
    const [low, high] = t.full ? [0, 360] : [Math.min(...t.angle), Math.max(...t.angle)];
    const range = extent(...(shown.common ? t.residual.slice(data.start) : []), t.residual[shown.model], [2.5 * t.noise]), limit = 1.06 * Math.max(-range[0], range[1]);
    const marks = shown.events ? t.events.filter(([, a]) => a >= low && a <= high) : [], letters = spread(marks.map((m) => m[1]), (high - low) * 11 / width);
    const line = (y) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: { color: look.edge, width: 0.8 } });
    return {
      font, showlegend: false, margin: { l: 46, r: 8, t: 18, b: 34 }, hovermode: "closest", dragmode: "zoom", plot_bgcolor: "#fff",
      xaxis: { range: [low, high], dtick: niceTurn((high - low) * 34 / width), tickangle: 0, title: { text: "plot angle, °", standoff: 4, font }, showgrid: false, zeroline: false, linecolor: look.nominal, ticks: "outside", ticklen: 3 },
      yaxis: { range: [-limit, limit], title: { text: "residual, µm", standoff: 4, font }, gridcolor: look.grid, zerolinecolor: look.nominal, nticks: 6 },
      shapes: [
        ...(shown.noise ? [{ type: "rect", xref: "paper", x0: 0, x1: 1, y0: -2 * t.noise, y1: 2 * t.noise, fillcolor: look.band, line: { width: 0 }, layer: "below" }, line(2 * t.noise), line(-2 * t.noise)] : []),
        ...marks.map(([axis, a]) => ({ type: "line", yref: "paper", x0: a, x1: a, y0: 0, y1: 1, line: { color: look.axes[axis], width: 1, dash: "dash" }, name: axis })),
      ],
      annotations: marks.map(([axis], i) => ({ text: `<b>${axis}</b>`, x: letters[i], y: 1, yref: "paper", yanchor: "bottom", showarrow: false, font: { size: 11, color: look.axes[axis] } })),
    };
  };

  const draw = (card) => {
    card.stale = false;
    const t = card.test, k = card.index, m = data.models[shown.model];
    card.number.textContent = fixed(m.tests_um[k], 2);
    card.number.dataset.json = `/models/${shown.model}/tests_um/${k}`;
    if (!t.text) t.text = places(t);
    Plotly.react(card.polar, polarTraces(t), polarLayout(t), config);
    Plotly.react(card.residual, residualTraces(t), residualLayout(t, Math.max(card.residual.clientWidth - 54, 120)), config);
  };
  const refresh = () => {
    for (const card of cards) {
      card.stale = true;
      if (card.near && !card.root.hidden) draw(card);
    }
  };

  // -- models --------------------------------------------------------------------------------------------------------
  const drawLadder = () => {
    const values = data.models.map((m) => m.rms_um), floor = Math.min(...values, data.noise_um) / 1.6, top = Math.max(...values) * 2;
    const ticks = logTicks(floor, top), names = data.models.map((m) => plainText(m.label));
    Plotly.react("ladder-plot", [
      { type: "scatter", mode: "lines+markers+text", x: values.map((_, i) => i), y: values, text: values.map((v) => `${fixed(v, 2)} µm`), textposition: "top right", line: { shape: "hvh", color: look.nominal, width: 1.2 }, cliponaxis: false, hovertemplate: "%{customdata}<br>%{y:.3f} µm<extra></extra>", customdata: names,
        marker: { size: values.map((_, i) => i === shown.model ? 15 : 9), color: values.map((_, i) => i === shown.model ? look.simulated : "#ffffff"), line: { color: look.simulated, width: 2 } } },
    ], {
      font, showlegend: false, margin: { l: 60, r: 84, t: 14, b: 44 }, hovermode: "closest", dragmode: false, plot_bgcolor: "#fff",
      xaxis: { tickvals: values.map((_, i) => i), ticktext: names.map((name) => name.startsWith("+") ? name : name.replace(/ (?=\S*$)/, "<br>")), range: [-0.4, last + 0.5], showgrid: false, zeroline: false, fixedrange: true },
      yaxis: { type: "log", range: [Math.log10(floor), Math.log10(top)], tickvals: ticks, ticktext: ticks.map(String), title: { text: "RMS residual, µm", font }, gridcolor: look.grid, fixedrange: true },
      shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: data.noise_um, y1: data.noise_um, line: { color: look.former, width: 1, dash: "dash" } }],
      annotations: [{ text: `noise floor<br>${fixed(data.noise_um, 2)} µm`, xref: "paper", x: 1.005, xanchor: "left", y: Math.log10(data.noise_um), showarrow: false, align: "left", font: { size: 11, color: look.former } }],
    }, { ...config, displayModeBar: false });
    if (!drawLadder.heard) byId("ladder-plot").on("plotly_click", (e) => step(e.points[0].x));
    drawLadder.heard = true;
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
  const chip = (text, checked, change, name, colour, dashed) => {
    const box = element("input", { type: "checkbox", checked, name });
    box.addEventListener("change", () => change(box.checked));
    const line = element("span", { className: "line" });
    line.style.borderTop = `2px ${dashed ? "dashed" : "solid"} ${colour}`;
    return element("label", {}, box, ...(colour ? [line] : []), text);
  };
  const boxes = [];
  traces.forEach((packed, index) => {
    const test = unpack(packed), info = data.tests[index];
    const polar = element("div", { className: "polar" }), residual = element("div", { className: "residual-plot" }), number = element("strong");
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
    for (const card of cards) { if (card.polar.data) { Plotly.purge(card.polar); Plotly.purge(card.residual); } }
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
