"use strict";
// Under a table that is wider than its place: how many of its columns are beyond the right edge.

for (const box of document.querySelectorAll(".scroll")) {
  const told = document.createElement("p");
  told.className = "more";
  box.after(told);
  const tell = () => {
    const edge = box.getBoundingClientRect().right;
    const heads = [...box.querySelectorAll("thead th")];
    const beyond = heads.filter((head) => head.getBoundingClientRect().right > edge + 1).length;
    told.hidden = box.scrollWidth <= box.clientWidth + 1;
    told.classList.toggle("end", beyond === 0);
    told.textContent = `${beyond} more ${beyond === 1 ? "column" : "columns"}: the table scrolls sideways →`;
  };
  box.addEventListener("scroll", tell, { passive: true });
  new ResizeObserver(tell).observe(box);
}
