"use strict";
const config = { responsive: true, displayModeBar: false };
const touched = matchMedia("(pointer: coarse)").matches; // a drag scrolls the page
const hidden = box => box.closest("details:not([open])");
const boxes = root => [...root.querySelectorAll(".plot")].filter(box => !hidden(box));

function draw(root) {
  for (const box of boxes(root)) {
    if (box.data) continue;
    const plot = JSON.parse(box.nextElementSibling.textContent);
    Plotly.newPlot(box, plot.data, { ...plot.layout, dragmode: touched ? false : "zoom" }, config);
  }
}

function onPaper(on) {
  document.body.classList.toggle("paper", on);
  for (const box of boxes(document)) Plotly.relayout(box, on ? { width: box.clientWidth } : { width: null, autosize: true });
}

for (const part of document.querySelectorAll("details")) part.addEventListener("toggle", () => draw(part));
addEventListener("beforeprint", () => onPaper(true));
addEventListener("afterprint", () => onPaper(false));
draw(document);
