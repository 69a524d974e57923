// Shows the page in the reader's language: by ?language=de in its address, else the one chosen before, else the page's own.
// Units of text are found and hashed as in page_languages.py; a translation is text, and moves elements of its unit only.
(function () {
  var holder = document.getElementById("languages");
  if (!holder || !window.DecompressionStream) { return; }
  var names = JSON.parse(holder.getAttribute("data-names")), first = 0xE000;
  var inline = { A: 1, EM: 1 }, whole = { CODE: 1, KBD: 1, SAMP: 1, WBR: 1 };
  var skipped = { SCRIPT: 1, STYLE: 1, PRE: 1, TEXTAREA: 1, NOSCRIPT: 1 };
  var attributes = ["aria-label", "title", "placeholder", "label"];
  var separators = [". ", " · ", ", ", ": "];
  var known = new Map(), templates = [], decimal = ".";

  function remembered(tag) {
    try {
      if (tag) { localStorage.setItem("grade-language", tag); }
      return localStorage.getItem("grade-language");
    } catch (refused) { return null; }
  }
  function chosen() {
    var asked = [new URLSearchParams(location.search).get("language"), remembered(), holder.getAttribute("data-chosen")];
    return asked.filter(function (tag) { return tag === "en" || Object.hasOwn(names, tag || ""); })[0] || "en";
  }
  function offer(tag) {
    var select = document.createElement("select");
    select.id = "language";
    select.setAttribute("translate", "no");
    select.setAttribute("aria-label", "Language · Sprache · Idioma");
    Object.entries(Object.assign({ en: "English" }, names)).forEach(function (each) {
      var option = new Option(each[1], each[0], false, each[0] === tag);
      option.lang = each[0];
      select.append(option);
    });
    select.addEventListener("change", function () {
      var address = new URL(location.href);
      remembered(select.value);
      address.searchParams.set("language", select.value);
      location.href = address.href;
    });
    document.querySelector("header.top").append(select);
  }

  function hash(text) {
    var value = 0x811C9DC5;
    for (var i = 0; i < text.length; i++) { value = Math.imul(value ^ text.charCodeAt(i), 0x01000193); }
    return btoa(String.fromCharCode(value >>> 16 & 255, value >>> 8 & 255, value & 255)).replace(/\+/g, "-").replace(/\//g, "_");
  }
  function message(text) {
    var found = known.get(hash(text));
    for (var i = 0; found === undefined && i < templates.length; i++) {
      var values = templates[i].pattern.exec(text);
      if (values) { found = templates[i].fill(values); }
    }
    return found;
  }
  function translation(text) {
    var found = message(text);
    if (found !== undefined) { return found; }
    if (/[^.]\.$/.test(text)) {
      found = message(text.slice(0, -1));
      if (found !== undefined) { return found + "."; }
    }
    return joined(text) || (decimal === "." ? text : text.replace(numbers, "$1" + decimal + "$2"));
  }
  // Scripts join texts of the page, such as a time, a moment and a note on it.
  function joined(text) {
    for (var i = 0; i < separators.length; i++) {
      var parts = text.split(separators[i]);
      if (parts.length > 1 && parts.some(function (part) { return message(part) !== undefined; })) {
        return parts.map(translation).join(separators[i]);
      }
    }
    var at = text.indexOf(": ");
    return at > 0 ? translation(text.slice(0, at)) + ": " + translation(text.slice(at + 2)) : "";
  }
  var numbers;
  function template(pair) {
    var numbered = [], pattern = pair[0].replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{(\d+)\}/g, function (all, number) {
      numbered.push(number);
      return "([^]*)";
    });
    return {
      pattern: new RegExp("^" + pattern + "$"),
      fill: function (values) {
        return pair[1].replace(/\{(\d+)\}/g, function (all, number) { return translation(values[numbered.indexOf(number) + 1]); });
      }
    };
  }

  function no(element) { return element.getAttribute("translate") === "no"; }
  function within(element) {
    if (whole[element.tagName]) { return true; }
    return inline[element.tagName] && Array.prototype.every.call(element.children, within);
  }
  // The text of nodes with marks; what each mark stands for goes into `marks`.
  function read(nodes, marks) {
    return nodes.map(function (node) {
      if (node.nodeType === 3) { return node.data; }
      if (whole[node.tagName] || no(node)) {
        marks.push({ node: node });
        return String.fromCharCode(first + marks.length - 1);
      }
      marks.push({ node: node, opens: true });
      var opening = String.fromCharCode(first + marks.length - 1), text = read(Array.from(node.childNodes), marks);
      marks.push({ node: node, closes: true });
      return opening + text + String.fromCharCode(first + marks.length - 1);
    }).join("");
  }
  function translate(nodes) {
    var marks = [], raw = read(nodes, marks), text = raw.replace(/[ \t\n\r\f]+/g, " ").replace(/^ | $/g, "");
    if (!text) { return; }
    var other = translation(text);
    if (other === text) { return; }
    var start = /^[ \t\n\r\f]/.test(raw) ? " " : "", end = /[ \t\n\r\f]$/.test(raw) ? " " : "";
    if (nodes.length === 1 && nodes[0].nodeType === 3) { nodes[0].data = start + other + end; return; }
    var parent = nodes[0].parentNode, at = document.createTextNode(start), open = [];
    parent.insertBefore(at, nodes[0]);
    nodes.forEach(function (node) { node.remove(); });
    var place = document.createDocumentFragment();
    (other + end).split(/([\uE000-\uF8FF])/).forEach(function (piece) {
      var mark = marks[piece.charCodeAt(0) - first];
      if (!mark) { place.append(piece); }
      else if (mark.opens) { mark.node.replaceChildren(); place.append(mark.node); open.push(place); place = mark.node; }
      else if (mark.closes) { place = open.pop(); }
      else { place.append(mark.node); }
    });
    at.after(place);
  }
  function visit(element) {
    if (skipped[element.tagName] || no(element)) { return; }
    attributes.forEach(function (name) {
      var value = element.getAttribute(name);
      if (value) {
        var text = value.replace(/[ \t\n\r\f]+/g, " ").trim(), other = translation(text);
        if (other !== text) { element.setAttribute(name, other); }
      }
    });
    visitChildren(element);
  }
  function visitChildren(element) {
    var row = [];
    Array.from(element.childNodes).forEach(function (node) {
      if (node.nodeType === 3 || (node.nodeType === 1 && within(node) && !skipped[node.tagName])) { row.push(node); return; }
      if (row.length) { translate(row); }
      row = [];
      if (node.nodeType === 1 && !whole[node.tagName]) { visit(node); }
    });
    if (row.length) { translate(row); }
    Array.prototype.forEach.call(element.querySelectorAll(":scope > a, :scope > em"), function (link) {
      attributes.forEach(function (name) {
        var value = link.getAttribute(name);
        if (value && !no(link)) { link.setAttribute(name, translation(value)); }
      });
    });
  }
  // Scripts change texts: the element around a changed text is translated again, of which only English text changes.
  function watch() {
    var observer = new MutationObserver(function (records) {
      var changed = new Set();
      records.forEach(function (record) {
        var target = record.target.nodeType === 1 ? record.target : record.target.parentElement;
        while (target && within(target)) { target = target.parentElement; }
        if (target && document.contains(target) && !target.closest("pre, code, textarea, [translate=no]")) { changed.add(target); }
      });
      changed.forEach(function (element) {
        if (!Array.from(changed).some(function (other) { return other !== element && other.contains(element); })) { visit(element); }
      });
      observer.takeRecords();
    });
    observer.observe(document.documentElement, { subtree: true, childList: true, characterData: true, attributeFilter: attributes });
  }

  var tag = chosen();
  offer(tag);
  if (tag === "en") { return; }
  var packed = Uint8Array.from(atob(holder.getAttribute("data-" + tag)), function (sign) { return sign.charCodeAt(0); });
  new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"))).json().then(function (content) {
    content[1].forEach(function (text, number) { known.set(content[0].slice(4 * number, 4 * number + 4), text); });
    decimal = content[3];
    numbers = new RegExp(content[4], "g");
    templates = content[2].filter(function (pair) { return pair[0].indexOf("{") >= 0; }).map(template);
    content[2].forEach(function (pair) { if (pair[0].indexOf("{") < 0) { known.set(hash(pair[0]), pair[1]); } });
    document.documentElement.lang = tag;
    visit(document.documentElement);
    watch();
  });
})();
