"use strict";
(function () {
  var all = function () { return Array.prototype.slice.call(document.querySelectorAll("details")); };
  var button = document.getElementById("toggle");
  button.parentNode.hidden = false;
  button.addEventListener("click", function () {
    var open = button.getAttribute("aria-pressed") !== "true";
    all().forEach(function (d) { d.open = open; });
    button.setAttribute("aria-pressed", String(open));
    button.textContent = open ? "Collapse all" : "Expand all";
    reach();
  });
  // What scrolls can be scrolled with the keyboard, in browsers too that do not see to it.
  function reach() {
    Array.prototype.forEach.call(document.querySelectorAll(".scroll, .source"), function (e) {
      if (e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight) { e.tabIndex = 0; } else { e.removeAttribute("tabindex"); }
    });
  }
  document.addEventListener("toggle", reach, true);
  window.addEventListener("resize", reach);
  reach();
  function reveal() {
    var target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) { return; }
    for (var e = target; e; e = e.parentElement) {
      if (e.tagName === "DETAILS") { e.open = true; }
    }
    // Else a browser that loads the page again goes to where it was, after this.
    history.scrollRestoration = "manual";
    target.scrollIntoView();
  }
  window.addEventListener("hashchange", reveal);
  reveal();
})();
