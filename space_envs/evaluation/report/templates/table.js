"use strict";
// Tables that are sorted by their heads, and the filters of a page.

/**
 * Sort a table's rows by a column; what has no figure stays behind, whichever way. Rows with equal figures
 * stand in the order in which the page came, which is that of the rank: clicks before do not matter, and a
 * click on the rank brings that order back.
 */
function sortTable(table, column) {
  const heads = [...table.tHead.rows[0].cells];
  const head = heads[column];
  const first = head.querySelector("button").dataset.first;
  const other = first === "ascending" ? "descending" : "ascending";
  const order = head.getAttribute("aria-sort") === first ? other : first;
  for (const each of heads) each.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", order);
  const sign = order === "ascending" ? 1 : -1;
  const compare = (left, right) => {
    const a = left.cells[column].dataset.sort;
    const b = right.cells[column].dataset.sort;
    const place = left.dataset.place - right.dataset.place;
    if (column === 0) return sign * a.localeCompare(b) || place;
    if (a === "" || b === "") return (a === "") - (b === "") || place;
    return sign * (Number(a) - Number(b)) || place;
  };
  const body = table.tBodies[0];
  body.append(...[...body.rows].sort(compare));
}

/** Show the rows whose name holds every word, in the tasks of the robot, difficulty, goal and split chosen. */
function filterPage(form) {
  const page = form.closest("article.page");
  const words = form.querySelector(".words").value.toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = [...form.querySelectorAll("select[data-filter]")];
  let shown = 0;
  let all = 0;
  for (const task of page.querySelectorAll("section.task")) {
    task.hidden = chosen.some((select) => select.value && task.dataset[select.dataset.filter] !== select.value);
    if (task.hidden) continue;
    for (const row of task.querySelectorAll("table.sortable tbody tr")) {
      const name = row.dataset.name.toLowerCase();
      row.hidden = !words.every((word) => name.includes(word));
      all += 1;
      shown += !row.hidden;
    }
  }
  form.querySelector("output").textContent = shown < all ? `${shown} of ${all} rows` : "";
}

for (const table of document.querySelectorAll("table.sortable")) {
  [...table.tBodies[0].rows].forEach((row, place) => {
    row.dataset.place = place;
  });
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    head.querySelector("button").addEventListener("click", () => sortTable(table, column));
  });
}
for (const form of document.querySelectorAll("form.filters")) {
  form.addEventListener("input", () => filterPage(form));
  form.addEventListener("submit", (event) => event.preventDefault());
}
