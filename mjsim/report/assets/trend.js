// The trend of several campaigns: figures and parameters with their intervals, shown one by one or together.
"use strict";
(() => {
  const { look, font, config, plainText, element } = mjsim;
  const data = mjsim.read("mjsim-numbers");
  const dates = data.campaigns.every((c) => c.date);
  const place = data.campaigns.map((c, i) => dates ? c.date : i);
  const colours = ["#222222", "#d9480f", "#0072b2", "#007a5a", "#b3007d", "#8a6d00", "#5b3fb5"], dashes = ["solid", "dash", "dot"];
  for (const plot of document.querySelectorAll("[data-group]")) {
    const series = data.series.filter((s) => s.group === plot.dataset.group);
    const changed = series.filter((s) => ["grew", "shrank"].includes(s.verdict));
    const shown = new Set((changed.length ? changed : series).slice(0, 4));
    const units = () => [...new Set(series.filter((s) => shown.has(s)).map((s) => s.unit || "ratio"))];
    const draw = () => Plotly.react(plot, series.map((s, i) => ({
      type: "scatter", mode: "lines+markers", name: plainText(s.name), x: place, y: s.values, visible: shown.has(s), connectgaps: true,
      yaxis: units().indexOf(s.unit || "ratio") === 1 ? "y2" : "y",
      line: { color: colours[i % 7], width: 1.4, dash: dashes[Math.floor(i / 7) % 3] }, marker: { size: 7 },
      error_y: { type: "data", symmetric: false, array: s.values.map((v, k) => s.highs[k] === null ? 0 : s.highs[k] - v), arrayminus: s.values.map((v, k) => s.lows[k] === null ? 0 : v - s.lows[k]), thickness: 1.2, width: 4 },
      text: data.campaigns.map((c, k) => plainText(`${c.name}${s.notes[k] ? `, ${s.notes[k]}` : ""}`)), hovertemplate: `%{text}<br>%{y:.5~g} ${s.unit}<extra>${plainText(s.name)}</extra>`,
    })), {
      font, margin: { l: 64, r: 64, t: 10, b: 40 }, hovermode: "closest", plot_bgcolor: "#fff", showlegend: true, legend: { orientation: "h", y: -0.2 },
      xaxis: { type: dates ? "date" : "linear", tickvals: place, ticktext: data.campaigns.map((c) => plainText(dates ? c.date : c.name)), gridcolor: look.grid, zeroline: false },
      yaxis: { title: { text: units()[0] || "", font }, gridcolor: look.grid, zerolinecolor: look.nominal },
      yaxis2: { title: { text: units()[1] || "", font }, overlaying: "y", side: "right", showgrid: false, visible: units().length > 1 },
    }, config);
    for (const s of series) {
      const box = element("input", { type: "checkbox", checked: shown.has(s), name: s.name });
      box.addEventListener("change", () => { if (box.checked) shown.add(s); else shown.delete(s); draw(); });
      document.querySelector(`[data-chips="${plot.dataset.group}"]`).append(element("label", {}, box, s.name));
    }
    draw();
  }
})();
