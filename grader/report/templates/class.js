"use strict";
(function () {
  var byId = function (id) { return document.getElementById(id); };
  var all = function (selector, within) { return Array.prototype.slice.call((within || document).querySelectorAll(selector)); };

  // -- Sorting: a button in each heading; what has no value stands last either way. --
  var collator = new Intl.Collator("en", { numeric: true, sensitivity: "base" });
  function compare(kind, a, b) { return kind === "number" ? a - b : collator.compare(a, b); }
  function valueOf(row, column, kind) {
    var cell = row.cells[column];
    if (kind === "number") { return cell.hasAttribute("data-value") ? Number(cell.getAttribute("data-value")) : null; }
    var text = (cell.querySelector(".student") || cell).textContent.trim();
    return text === "–" ? null : text;
  }
  function sort(table, heading, descending) {
    var kind = heading.getAttribute("data-kind"), column = heading.cellIndex, body = table.tBodies[0];
    var keyed = Array.prototype.map.call(body.rows, function (row, place) {
      return { row: row, place: place, value: valueOf(row, column, kind) };
    });
    keyed.sort(function (a, b) {
      if (a.value === null || b.value === null) { return (a.value === null) - (b.value === null) || a.place - b.place; }
      return (descending ? compare(kind, b.value, a.value) : compare(kind, a.value, b.value)) || a.place - b.place;
    });
    keyed.forEach(function (entry) { body.appendChild(entry.row); });
    all("th[aria-sort]", table.tHead).forEach(function (other) { other.removeAttribute("aria-sort"); });
    heading.setAttribute("aria-sort", descending ? "descending" : "ascending");
  }
  all("table.sortable").forEach(function (table) {
    all("thead th", table).forEach(function (heading) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = heading.textContent;
      // Browsers leave buttons out where a heading is repeated on the next sheet of paper.
      var printed = document.createElement("span");
      printed.className = "paper";
      printed.textContent = heading.textContent;
      heading.textContent = "";
      heading.append(button, printed);
      button.addEventListener("click", function () {
        var now = heading.getAttribute("aria-sort");
        sort(table, heading, now ? now === "ascending" : heading.getAttribute("data-kind") === "number");
        if (table.id === "class-table") { tell(); }
      });
    });
  });

  // -- Filtering. --
  var form = byId("filters"), status = byId("status"), table = byId("class-table");
  var name = byId("f-name"), place = byId("f-place"), outcome = byId("f-outcome"), needs = byId("f-needs");
  var rows = Array.prototype.slice.call(table.tBodies[0].rows);
  var names = new Map(rows.map(function (row) { return [row, row.querySelector(".student").textContent.toLowerCase()]; }));
  var mistake = null;
  var columns = all("#f-place optgroup").length;

  function fits(row) {
    if (names.get(row).indexOf(name.value.trim().toLowerCase()) < 0) { return false; }
    if (needs.checked && !row.hasAttribute("data-needs")) { return false; }
    if (mistake && row.getAttribute("data-mistakes").split(" ").indexOf(mistake.number) < 0) { return false; }
    if (!outcome.value) { return true; }
    var codes = row.getAttribute("data-codes");
    var looked = place.value ? codes.charAt(Number(place.value)) : codes.slice(0, columns);
    return looked.split("").some(function (code) { return outcome.value.indexOf(code) >= 0; });
  }
  function filter() {
    rows.forEach(function (row) { row.hidden = !fits(row); });
    tell();
  }
  function tell() {
    var shown = rows.filter(function (row) { return !row.hidden; }).length;
    var sorted = table.tHead.querySelector("th[aria-sort]");
    var text = shown + " of " + rows.length + " shown";
    if (mistake) { text += ", with the mistake “" + mistake.title + "”"; }
    if (sorted) { text += ", by " + sorted.querySelector("button").textContent + ", " + sorted.getAttribute("aria-sort"); }
    status.textContent = text + ".";
  }
  if (rows.length) { form.hidden = false; status.hidden = false; }
  form.addEventListener("input", filter);
  form.addEventListener("change", filter);
  form.addEventListener("submit", function (event) { event.preventDefault(); });
  form.addEventListener("reset", function () { mistake = null; setTimeout(filter, 0); });
  all("button.show").forEach(function (button) {
    button.hidden = false;
    button.addEventListener("click", function (event) {
      event.preventDefault();
      form.reset();
      mistake = { number: button.getAttribute("data-mistake"), title: button.getAttribute("data-title") };
      filter();
      byId("students").scrollIntoView();
      status.focus();
    });
  });
  filter();

  // -- Paper shows what is folded. --
  var closed = [];
  window.addEventListener("beforeprint", function () {
    closed = all("details").filter(function (d) { return !d.open; });
    closed.forEach(function (d) { d.open = true; });
  });
  window.addEventListener("afterprint", function () {
    closed.forEach(function (d) { d.open = false; });
    closed = [];
  });
})();
