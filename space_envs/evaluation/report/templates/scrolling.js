"use strict";
// Under a table that is wider than its place: how many of its columns are beyond the right edge.

for (const box of document.querySelectorAll(".scroll")) {
  const note = document.createElement("p");
  note.className = "more";
  box.after(note);
  const tell = () => {
    const edge = box.getBoundingClientRect().right;
    const heads = [...box.querySelectorAll("thead th")];
    const beyond = heads.filter((head) => head.getBoundingClientRect().right > edge + 1).length;
    note.hidden = box.scrollWidth <= box.clientWidth + 1;
    note.classList.toggle("end", beyond === 0);
    note.textContent = `${beyond} more ${beyond === 1 ? "column" : "columns"}: the table scrolls sideways →`;
  };
  box.addEventListener("scroll", tell, { passive: true });
  new ResizeObserver(tell).observe(box);
}
