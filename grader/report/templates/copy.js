// Buttons that copy commands, code, output, errors and appeals; links that copy their own address; questions.
(function () {
  var texts = {
    ".commands code, .howto code": ["command", whole],
    "pre.source": ["code", function (pre) { return lines(pre, ".src code"); }],
    "pre.file-text": ["file", function (pre) { return text(pre, ".mark-of"); }],
    "pre.lines": ["output", function (pre) { return lines(pre, ".out"); }],
    "p.reason": ["error", whole],
    "pre.appeal-text": ["question", whole]
  };
  function whole(from) { return text(from, ".copy").trim(); }
  // The text of an element without some elements in it.
  function text(from, without) {
    var own = Array.prototype.filter.call(from.childNodes, function (node) { return !node.matches || !node.matches(without); });
    return own.map(function (node) { return node.textContent; }).join("");
  }
  function lines(from, selector) {
    return Array.prototype.map.call(from.querySelectorAll(selector), function (line) { return line.lastChild.textContent.replace(/\n$/, ""); }).join("\n");
  }
  function copy(text, told) {
    var tell = function () { parts.tell(told); };
    if (navigator.clipboard) { return navigator.clipboard.writeText(text).then(tell, function () { select(text, tell); }); }
    select(text, tell);
  }
  // A browser without a clipboard for pages copies what is selected.
  function select(text, tell) {
    var area = document.body.appendChild(parts.make("textarea", "sr", ""));
    area.value = text;
    area.select();
    if (document.execCommand("copy")) { tell(); }
    area.remove();
  }
  function add(from, name, read) {
    var button = parts.make("button", "copy", "");
    button.type = "button";
    button.title = "Copy this " + name;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", function () { copy(read(from), "Copied: " + name); });
    if (from.tagName === "PRE") { from.before(button); } else if (from.tagName === "P") { from.append(" ", button); } else { from.after(button); }
  }
  // The text of a question; a check that earned its points has none in the page.
  function question(asking) {
    var written = asking.querySelector(".appeal-text");
    if (written) { return whole(written); }
    var head = document.querySelector(".page").dataset.appeal + ", check " + asking.querySelector("code").textContent;
    return [head, "Link: report.html" + asking.querySelector(".link-sign").hash, "What I think is wrong:"].join("\n");
  }
  function ask(from) {
    var text = question(from.closest(".asking"));
    if (from.tagName === "BUTTON") { copy(text, "Copied. Paste it into a message to your instructor."); return; }
    from.href = from.href.split("&body=")[0] + "&body=" + encodeURIComponent(text + "\n");
  }
  parts.whenBuilt(function (root) {
    Object.keys(texts).forEach(function (selector) {
      parts.each(root, selector, function (from) { add(from, texts[selector][0], texts[selector][1]); });
    });
    parts.each(root, "button.ask", function (button) { button.hidden = false; });
  });
  document.addEventListener("click", function (event) {
    var from = event.target.closest(".ask, .link-sign");
    if (!from) { return; }
    if (from.matches(".ask")) { ask(from); } else { copy(from.href, "Copied: link"); }
  });
})();
