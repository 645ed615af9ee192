// Tables that are sorted by the button in the head of a column, and whose rows are chosen by arrow keys.
"use strict";

(() => {
  const key = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.key === undefined ? cell.textContent : Number(cell.dataset.key);
  };

  const compared = (one, other) =>
    typeof one === "string" ? one.localeCompare(other, undefined, { numeric: true }) : one - other;

  const sort = (table, head) => {
    const column = head.cellIndex;
    const ascending = head.getAttribute("aria-sort") === "descending";
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    const rows = [...table.tBodies[0].rows];
    rows.sort((one, other) => compared(key(one, column), key(other, column)) * (ascending ? 1 : -1));
    table.tBodies[0].append(...rows);
  };

  // Tab reaches one row of a table only, that which was used last: 96 would be in the way.
  const reach = (table, used) => {
    for (const button of table.tBodies[0].querySelectorAll("button")) button.tabIndex = button === used ? 0 : -1;
  };

  const step = (event, table) => {
    const arrow = matest.arrow(event);
    if (arrow === null || arrow[1] === 0) return;
    const buttons = [...table.tBodies[0].querySelectorAll("button")];
    const next = buttons[buttons.indexOf(event.target) + Math.sign(arrow[1])];
    if (next === undefined) return;
    next.focus();
    next.click();
  };

  for (const table of document.querySelectorAll("table.sortable")) {
    for (const head of table.tHead.rows[0].cells) {
      head.querySelector("button").addEventListener("click", () => sort(table, head));
    }
    table.tBodies[0].addEventListener("keydown", (event) => step(event, table));
    table.tBodies[0].addEventListener("focusin", (event) => reach(table, event.target));
    reach(table, table.tBodies[0].querySelector("button"));
  }
})();
