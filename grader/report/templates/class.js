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
      // Browsers leave buttons out where a heading is repeated on the next sheet of paper.
      var printed = document.createElement("span");
      printed.className = "paper";
      heading.setAttribute("data-title", heading.firstChild.textContent.trim());
      printed.append.apply(printed, Array.prototype.map.call(heading.childNodes, function (n) { return n.cloneNode(true); }));
      var label = document.createElement("span");
      label.append.apply(label, Array.prototype.slice.call(heading.childNodes));
      button.append(label);
      heading.append(button, printed);
      button.addEventListener("click", function () {
        var now = heading.getAttribute("aria-sort");
        sort(table, heading, now ? now === "ascending" : heading.getAttribute("data-kind") === "number");
        if (table.id === "class-table") { tell(); remember(); }
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
    remember();
  }
  function visible() { return rows.filter(function (row) { return !row.hidden; }); }
  // The last row holds the means of those that are shown and graded.
  function average() {
    var cells = table.tFoot ? table.tFoot.rows[0].cells : [];
    var graded = visible().filter(function (row) { return row.cells[1].hasAttribute("data-value"); });
    Array.prototype.forEach.call(cells, function (cell, column) {
      var values = graded.map(function (row) { return row.cells[column].getAttribute("data-value"); });
      values = values.filter(function (value) { return value !== null; });
      var sum = values.reduce(function (before, value) { return before + Number(value); }, 0);
      if (column === 0) { cell.textContent = "Mean of " + graded.length; }
      else if (cell.textContent) { cell.textContent = values.length ? (sum / values.length).toFixed(2) : "–"; }
    });
  }
  function tell() {
    average();
    var shown = visible().length;
    var sorted = table.tHead.querySelector("th[aria-sort]");
    var text = shown + " of " + rows.length + " shown";
    if (mistake) { text += ", with the mistake “" + mistake.title + "”"; }
    if (sorted) { text += ", by " + sorted.getAttribute("data-title") + ", " + sorted.getAttribute("aria-sort"); }
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
  // -- The address says what is shown, so that it can be sent and kept. --
  function remember() {
    var sorted = table.tHead.querySelector("th[aria-sort]"), chosen = place.selectedOptions[0];
    var said = new URLSearchParams();
    if (name.value) { said.set("name", name.value); }
    if (place.value) { said.set("in", chosen.getAttribute("data-id")); }
    if (outcome.value) { said.set("outcome", outcome.value); }
    if (needs.checked) { said.set("needs", "attention"); }
    if (mistake) { said.set("mistake", mistake.number); }
    if (sorted) { said.set("by", sorted.cellIndex + (sorted.getAttribute("aria-sort") === "descending" ? "d" : "")); }
    var now = said.toString() ? "#show?" + said : "";
    if (now || location.hash.indexOf("#show?") === 0) { history.replaceState(null, "", location.href.split("#")[0] + now); }
  }
  function recall() {
    if (location.hash.indexOf("#show?") !== 0) { return filter(); }
    var said = new URLSearchParams(location.hash.slice(6)), by = /^(\d+)(d?)$/.exec(said.get("by") || "");
    name.value = said.get("name") || "";
    var option = all("option", place).filter(function (one) { return one.getAttribute("data-id") === said.get("in"); })[0];
    place.value = option ? option.value : "";
    outcome.value = said.get("outcome") || "";
    if (outcome.selectedIndex < 0) { outcome.value = ""; }
    needs.checked = said.get("needs") === "attention";
    var button = all("button.show").filter(function (b) { return b.getAttribute("data-mistake") === said.get("mistake"); })[0];
    mistake = button ? { number: said.get("mistake"), title: button.getAttribute("data-title") } : null;
    var heading = by && table.tHead.rows[0].cells[Number(by[1])];
    if (heading) { sort(table, heading, by[2] === "d"); }
    filter();
    byId("students").scrollIntoView();
  }
  window.addEventListener("hashchange", recall);

  byId("f-copy").addEventListener("click", function () {
    var text = visible().map(function (row) { return row.querySelector(".student").textContent.trim(); });
    function done() { tell(); status.textContent += " " + (text.length === 1 ? text.length + " name copied." : text.length + " names copied."); }
    function byHand() {
      var area = document.createElement("textarea");
      area.value = text.join("\n");
      document.body.append(area);
      area.select();
      if (document.execCommand("copy")) { done(); }
      area.remove();
      byId("f-copy").focus();
    }
    if (navigator.clipboard) { navigator.clipboard.writeText(text.join("\n")).then(done, byHand); } else { byHand(); }
  });
  recall();

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
