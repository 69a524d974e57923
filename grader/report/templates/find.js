// Search: hides checks, lines and files without the words, unfolds parts that have them, and marks the places.
(function () {
  var PARTS = ".check, .above, .criterion, .session, .output, .out, .gap, .tl-list tbody tr", MOST = 2000;
  var WANTED = {lost: ".failed, .partial, .not-reached", open: ".undecided", earned: ".passed, .excused"};
  function byId(id) { return document.getElementById(id); }
  var form = byId("find"), field = byId("find-words"), wanted = byId("find-wanted"), told = byId("found"), opened = [], places = [], at = -1, timer = null;

  function has(text, words) { return text.toLowerCase().indexOf(words) >= 0; }
  // The text of a folded part without the line that is always shown.
  function inside(details) {
    return Array.prototype.map.call(details.children, function (e) { return e.tagName === "SUMMARY" ? "" : e.textContent; }).join(" ");
  }
  function matches(part, words) {
    var selector = WANTED[wanted.value], check = part.matches(".check");
    if (selector && part.matches(".above")) { return false; }
    if (selector && check && !part.matches(selector)) { return false; }
    if (selector && part.matches(".criterion")) { return Array.prototype.some.call(part.querySelectorAll(".check"), function (c) { return matches(c, words); }); }
    return has(part.textContent, words);
  }
  function restore() {
    opened.forEach(function (details) { details.open = false; });
    opened = [];
    parts.each(document, ".unfound", function (part) { part.classList.remove("unfound"); });
  }
  function open(details) {
    if (!details.open) { opened.push(details); details.open = true; }
  }
  function search() {
    var words = field.value.trim().toLowerCase();
    restore();
    if (words) { parts.buildAll(); }
    if (words || wanted.value) {
      parts.each(document, PARTS, function (part) { part.classList.toggle("unfound", !matches(part, words)); });
      parts.each(document, "details.criterion:not(.unfound)", open);
    }
    if (words) {
      parts.each(document, "details:not(.unfound)", function (details) { if (has(inside(details), words)) { open(details); } });
    }
    places = words ? placesOf(words) : [];
    at = -1;
    mark();
    var lines = document.querySelectorAll(".check:not(.unfound)").length;
    told.textContent = words ? counted(places.length) : wanted.value ? lines + " checks" : "";
  }
  function counted(number) {
    if (number === 1) { return number + " place"; }
    return number < MOST ? number + " places" : number + " or more places";
  }
  // The places of the words in the text that is shown, as ranges.
  function placesOf(words) {
    var found = [], range, walker = document.createTreeWalker(document.querySelector(".page"), NodeFilter.SHOW_TEXT);
    while (walker.nextNode() && found.length < MOST) {
      var text = walker.currentNode, low = text.data.toLowerCase();
      for (var n = low.indexOf(words); n >= 0 && low.length === text.length && text.parentElement.checkVisibility({contentVisibilityAuto: false}) && found.length < MOST; n = low.indexOf(words, n + words.length)) {
        range = document.createRange();
        range.setStart(text, n);
        range.setEnd(text, n + words.length);
        found.push(range);
      }
    }
    return found.filter(function (each) { return !each.startContainer.parentElement.closest(".top, .tools, .summary"); });
  }
  function mark() {
    if (!window.Highlight) { return; }
    CSS.highlights.set("found", new Highlight(...places));
    CSS.highlights.set("found-now", new Highlight(...places.slice(at, at + 1).filter(function () { return at >= 0; })));
  }
  function go(step) {
    if (!places.length) { return; }
    at = (at + step + places.length) % places.length;
    places[at].startContainer.parentElement.scrollIntoView({block: "center"});
    told.textContent = at + 1 + " of " + places.length;
    mark();
  }
  field.addEventListener("input", function () { clearTimeout(timer); timer = setTimeout(search, 150); });
  wanted.addEventListener("input", search);
  field.addEventListener("keydown", function (event) {
    if (event.key === "Enter") { clearTimeout(timer); if (at < 0 && !places.length) { search(); } go(event.shiftKey ? -1 : 1); }
  });
  document.addEventListener("keydown", function (event) {
    var writing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName) && event.target.type !== "range";
    if (event.key === "/" && !writing && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      field.focus();
      field.select();
    }
    if (event.key === "Escape" && (field.value || wanted.value) && (!writing || form.contains(event.target))) {
      field.value = wanted.value = "";
      search();
    }
  });
})();
