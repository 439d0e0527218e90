"use strict";
// A page is whole without this. It folds the menu on a phone, and opens what is folded for printing.
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
