(function () {
  var button = document.getElementById("toggle");
  button.closest(".tools").hidden = false;
  button.addEventListener("click", function () {
    var open = button.getAttribute("aria-pressed") !== "true";
    if (open) { parts.buildAll(); }
    parts.each(document, "details", function (d) { d.open = open; });
    button.setAttribute("aria-pressed", String(open));
    button.textContent = open ? "Collapse all" : "Expand all";
    reach();
  });
  // What scrolls can be scrolled with the keyboard, in browsers too that do not see to it.
  function reach() {
    parts.each(document, ".scroll, .source", function (e) {
      if (e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight) { e.tabIndex = 0; } else { e.removeAttribute("tabindex"); }
    });
  }
  document.addEventListener("toggle", reach, true);
  window.addEventListener("resize", reach);
  parts.whenBuilt(reach);
})();
