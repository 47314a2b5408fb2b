// What the pages share: data, look, numbers as the page prints them.
"use strict";
document.documentElement.classList.add("js");
const mjsim = (() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const look = {
    ink: "#1b1b1b", soft: "#5c5c5c", grid: "#dedede", nominal: "#8a8a8a", band: "#e4ebf2", edge: "#8fb0d0",
    measured: "#222222", simulated: "#d9480f", former: "#0072b2",
    axes: { X: "#0072b2", Y: "#007a5a", Z: "#8a6d00", A: "#b3007d", C: "#5b3fb5" },
  };
  const font = { family: getComputedStyle(document.body).fontFamily, size: 11.5, color: look.ink };
  const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"] };
  // fixed decimals, true minus sign, no negative zero, a dash for what is missing: as numbers.py does
  const fixed = (x, decimals) => x === null || x === undefined ? "–" : (x.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1")).replace("-", "−");
  const niceStep = (smallest) => {
    const decade = 10 ** Math.floor(Math.log10(smallest));
    return [1, 2, 5, 10].map((f) => f * decade).find((s) => s >= smallest * (1 - 1e-9));
  };
  // texts of the user's (names) go into plots as text, never as markup
  const plainText = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const element = (tag, properties = {}, ...children) => {
    const e = Object.assign(document.createElement(tag), properties);
    e.append(...children);
    return e;
  };
  const logTicks = (low, high) => {
    const out = [];
    for (let k = -4; k < 5; k++) for (const f of [1, 2, 5]) if (f * 10 ** k >= low && f * 10 ** k <= high) out.push(f * 10 ** k);
    return out;
  };
  return { read, look, font, config, fixed, niceStep, plainText, element, logTicks };
})();
