"use strict";
// Folds the menu on a phone, and opens folded sections for printing. A page is complete without this script.
const menu = document.querySelector("details.menu"), narrow = matchMedia("(max-width: 60rem)");
if (menu) {
  const fit = () => { menu.open = !narrow.matches; };
  fit();
  narrow.addEventListener("change", fit);
  menu.addEventListener("click", event => { if (narrow.matches && event.target.closest("a")) menu.open = false; });
}
addEventListener("beforeprint", () => document.querySelectorAll("details:not([open])").forEach(it => {
  it.open = true;
  it.dataset.folded = "";
}));
addEventListener("afterprint", () => document.querySelectorAll("[data-folded]").forEach(it => {
  it.open = false;
  delete it.dataset.folded;
}));
