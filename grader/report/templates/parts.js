"use strict";
// Folded parts wait as text in <noscript>, in the markup that a browser without scripts shows, and are built when they
// are needed: a page with long logs then starts with few elements.
var parts = (function () {
  var listeners = [];
  function each(from, selector, act) { Array.prototype.forEach.call(from.querySelectorAll(selector), act); }
  function make(name, style, words) {
    var made = document.createElement(name);
    made.className = style;
    made.textContent = words;
    return made;
  }
  // The text is the report's own markup, in which all text of students is escaped.
  function build(waiting) {
    var place = waiting.parentElement, made = new DOMParser().parseFromString(waiting.textContent, "text/html").body;
    waiting.replaceWith.apply(waiting, Array.from(made.childNodes));
    listeners.forEach(function (act) { act(place); });
  }
  function buildAll() { each(document, "noscript", build); }
  function find(id) {
    each(document, "noscript", function (waiting) {
      if (!document.getElementById(id) && waiting.textContent.indexOf(' id="' + id + '"') >= 0) { build(waiting); }
    });
    return document.getElementById(id);
  }
  function show(target) {
    for (var e = target; e; e = e.parentElement) { if (e.tagName === "DETAILS") { e.open = true; } }
  }
  function reveal() {
    var target = location.hash && find(decodeURIComponent(location.hash.slice(1)));
    if (!target) { return; }
    show(target);
    // Else a browser that loads the page again goes to where it was, after this.
    history.scrollRestoration = "manual";
    target.scrollIntoView();
  }
  var nearing = new IntersectionObserver(function (entries) {
    entries.forEach(function (entry) {
      if (entry.isIntersecting) {
        nearing.unobserve(entry.target);
        each(entry.target, "noscript", build);
      }
    });
  }, {rootMargin: "600px"});
  each(document, "noscript", function (waiting) { nearing.observe(waiting.parentElement); });
  // A part that is folded from the start is built when it is unfolded, wherever it is.
  function unfolded(event) {
    each(event.target, "noscript", function (waiting) { if (waiting.closest("details[open]") === event.target) { build(waiting); } });
  }
  window.addEventListener("load", function () { setTimeout(function () { document.addEventListener("toggle", unfolded, true); }); });
  window.addEventListener("hashchange", reveal);
  window.addEventListener("load", reveal);
  return {
    each: each, make: make, buildAll: buildAll, find: find, show: show,
    // Calls a function for the page, and again for each part that is built later.
    whenBuilt: function (act) { act(document); listeners.push(act); },
    // Tells something to screen readers, and shows it for a while.
    tell: function (words) { document.getElementById("told").textContent = words; }
  };
})();
