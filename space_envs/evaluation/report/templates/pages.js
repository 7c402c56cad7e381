"use strict";
// Pages behind the tabs, by the address's hash; and the choice of dark or light.

const pages = [...document.querySelectorAll("article.page")];
const tabs = [...document.querySelectorAll("nav.tabs a")];

/** Show the page that holds what the hash names, the first one where it names nothing. */
function showPage() {
  const target = document.getElementById(location.hash.slice(1));
  const page = target?.closest("article.page") ?? pages[0];
  for (const each of pages) each.hidden = each !== page;
  for (const tab of tabs) {
    if (tab.hash === `#${page.id}`) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  if (target && target !== page) target.scrollIntoView();
  else if (target) document.querySelector("nav.tabs").scrollIntoView();
}

/** The theme in force: what the reader chose here before, else what the system asks for. */
function currentTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  return document.documentElement.dataset.theme ?? (dark ? "dark" : "light");
}

/** Remembered choices; a browser may forbid them to files. */
function remember(theme) {
  try {
    if (theme === undefined) return localStorage.getItem("space-capture-theme");
    localStorage.setItem("space-capture-theme", theme);
  } catch {
    // Then the choice lasts as long as the page is open.
  }
  return null;
}

const chosenTheme = remember();
if (chosenTheme === "dark" || chosenTheme === "light") document.documentElement.dataset.theme = chosenTheme;
document.querySelector("button.theme").addEventListener("click", () => {
  const theme = currentTheme() === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = theme;
  remember(theme);
});
addEventListener("hashchange", showPage);
showPage();
