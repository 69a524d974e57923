"use strict";
(function () {
  var state = { items: [], reasons: [], criteria: {} }, current = null, change = null, chosen = null, timer = null, awaited = null;
  // The item whose form is shown, the number of the choice that is pressed in it, and what was written for others and not saved.
  var shown = null, picked = null, drafts = {};
  var byId = function (id) { return document.getElementById(id); };
  function make(tag, text, attributes) {
    var element = document.createElement(tag);
    element.textContent = text;
    Object.keys(attributes || {}).forEach(function (key) { element.setAttribute(key, attributes[key]); });
    return element;
  }
  function key(button, name) { button.append(" ", make("kbd", name)); return button; }

  // -- What the server says. --
  function ask(path, body) {
    var how = body ? { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) } : {};
    return fetch(path, how).then(function (answer) {
      return answer.json().then(function (plain) {
        if (answer.ok) { byId("problem").hidden = true; return plain; }
        throw plain;
      });
    }).catch(function (error) {
      var words = error.problem ? [error.problem + "."].concat(error.mistakes || [], error.remedy || []) : ["The desk does not answer. Is “grade review” still running?"];
      byId("problem").textContent = words.join("\n");
      byId("problem").hidden = false;
      throw error;
    });
  }
  function show(plain) {
    state = plain;
    byId("lab").textContent = plain.lab;
    var done = plain.items.filter(function (i) { return i.is_decided; }).length;
    byId("progress").textContent = done + " of " + plain.items.length + " decided, as " + plain.who;
    var waiting = plain.waiting.length ? "Writing " + plain.waiting.length + " result" + (plain.waiting.length > 1 ? "s" : "") + " …" : "All results are written";
    byId("settling").textContent = plain.failed.length ? "Not written: " + plain.failed.join(", ") : waiting;
    byId("undo").disabled = !plain.written;
    fillKinds();
    list();
    clearTimeout(timer);
    if (plain.waiting.length) { timer = setTimeout(function () { ask("queue").then(show, function () {}); }, 1500); }
  }
  function fillKinds() {
    var kinds = {}, select = byId("kind"), value = select.value;
    state.items.forEach(function (i) { kinds[i.kind] = (kinds[i.kind] || 0) + !i.is_decided; });
    select.length = 1;
    Object.keys(kinds).forEach(function (kind) { select.append(new Option(kind + " (" + kinds[kind] + ")", kind)); });
    select.value = value in kinds ? value : "";
  }

  // -- The queue. --
  function visible() {
    var kind = byId("kind").value, find = byId("find").value.toLowerCase(), order = byId("order").value;
    var found = state.items.filter(function (i) {
      var words = (i.name + " " + i.part.title + " " + i.part.id + " " + i.text).toLowerCase();
      return (!kind || i.kind === kind) && (byId("decided").checked || !i.is_decided) && words.indexOf(find) >= 0;
    });
    if (order === "points") { found.sort(function (a, b) { return b.points - a.points; }); }
    if (order === "name") { found.sort(function (a, b) { return a.name < b.name ? -1 : a.name > b.name; }); }
    return found;
  }
  function list() {
    var found = visible(), queue = byId("queue");
    queue.textContent = "";
    found.forEach(function (item) {
      var button = make("button", "", { type: "button" }), entry = make("li", "");
      button.append(make("b", item.name), make("span", item.is_decided ? "decided" : item.kind, item.is_decided ? { "class": "done" } : {}), make("small", item.part.title));
      button.addEventListener("click", function () { open(item); });
      button.dataset.id = item.id;
      entry.append(button);
      queue.append(entry);
    });
    var same = found.filter(function (i) { return current && i.id === current.id; })[0];
    if (same && current.state === same.state) { current = same; mark(); } else { open(same || found[0] || null); }
  }
  function mark() {
    Array.prototype.forEach.call(byId("queue").querySelectorAll("button"), function (b) {
      var is = current && b.dataset.id === current.id;
      b.setAttribute("aria-current", String(is));
      if (is) { b.scrollIntoView({ block: "nearest" }); }
    });
  }
  function step(by) {
    var found = visible(), at = found.findIndex(function (i) { return current && i.id === current.id; });
    if (found.length) { open(found[Math.max(0, Math.min(found.length - 1, at + by))]); }
  }

  // -- One item. --
  function open(item) {
    keep();
    current = item; shown = item; chosen = null;
    byId("item").hidden = !item; byId("empty").hidden = !!item;
    mark();
    if (!item) { return; }
    byId("about").textContent = item.name + " · " + item.kind + " · has " + item.part.earned + " of " + item.part.possible + " points";
    byId("title").textContent = item.part.title + (item.part.level ? " (" + item.part.id + ")" : "");
    byId("text").textContent = item.text;
    ["points", "reason", "comment"].forEach(function (id) { byId(id).value = ""; });
    var scope = byId("scope");
    scope.textContent = "";
    if (item.part.level === "check") { scope.append(new Option("this check", "check")); }
    // An appeal is answered where it was made.
    if (item.criterion && (item.kind !== "appeal" || item.part.level === "criterion")) { scope.append(new Option("all of “" + state.criteria[item.criterion] + "”", "criterion")); }
    if (!item.part.level) { scope.append(new Option("the whole submission", "")); }
    changes(item);
    reasons();
    restore(item);
    limit();
    byId("same").hidden = item.same.length < 2;
    byId("same").firstChild.textContent = "Same mistake (" + item.same.length + ") ";
    byId("report").href = "report?name=" + encodeURIComponent(item.name);
    var place = "evidence?name=" + encodeURIComponent(item.name) + "&what=" + encodeURIComponent(item.part.id);
    // What is beside an item is its own, or nothing.
    awaited = new URL(place, location.href).href;
    byId("evidence").hidden = true;
    byId("loading").hidden = false;
    byId("evidence").contentWindow.location.replace(awaited);
  }
  function keep() {
    if (!shown) { return; }
    var draft = { state: shown.state, scope: byId("scope").value, change: change, picked: picked };
    ["points", "reason", "comment"].forEach(function (id) { draft[id] = byId(id).value; });
    if (draft.change || draft.reason || draft.comment) { drafts[shown.id] = draft; } else { delete drafts[shown.id]; }
  }
  function restore(item) {
    var draft = drafts[item.id];
    if (!draft) { return; }
    byId("reason").value = draft.reason;
    byId("comment").value = draft.comment;
    // What somebody has decided meanwhile has to be seen before the points are chosen again.
    if (draft.state !== item.state) { return; }
    byId("scope").value = draft.scope;
    change = draft.change; picked = draft.picked;
    byId("points").value = draft.points;
    press(picked);
  }
  function choices(item) {
    var listed = (item.levels || []).map(function (level, n) {
      return { label: level.title, hint: level.description, key: "lmnoq".charAt(n), change: "set", share: level.credit };
    });
    if (item.part.level) {
      listed.push({ label: "Full points", key: "f", change: "set", share: 1 }, { label: "No points", key: "z", change: "set", share: 0 }, { label: "Excused", key: "e", change: "excused" });
    }
    // To look at open points does not decide them.
    if (item.kind === "undecided" || item.kind === "to grade") { return listed; }
    return listed.concat({ label: item.kind === "interference" ? "Looked at, no further consequence" : "Stays as it is", key: "a", change: "reviewed" });
  }
  function changes(item) {
    var group = byId("changes");
    group.textContent = "";
    change = null; picked = null;
    byId("points").disabled = !item.part.level;
    choices(item).forEach(function (choice, n) {
      var button = make("button", choice.label, { type: "button", "aria-pressed": "false", title: choice.hint || "" });
      if (choice.key) { key(button, choice.key); button.dataset.key = choice.key; }
      button.addEventListener("click", function () { choose(choice, n); });
      group.append(button);
    });
  }
  function choose(choice, n) {
    change = choice.change; picked = n;
    byId("points").value = "share" in choice ? String(Math.round(choice.share * possible() * 100) / 100) : "";
    press(n);
  }
  function press(n) {
    Array.prototype.forEach.call(byId("changes").children, function (b, at) { b.setAttribute("aria-pressed", String(at === n)); });
  }
  // The most points of what the decision is about: a check, its criterion, or the whole.
  function possible() { return Number(current.most[byId("scope").value]); }
  function limit() {
    byId("most").textContent = "of " + possible();
    var choice = picked === null ? null : choices(current)[picked];
    if (choice) { choose(choice, picked); }
  }
  byId("points").addEventListener("input", function () { change = "set"; picked = null; press(null); });
  byId("scope").addEventListener("change", limit);
  function reasons() {
    var group = byId("reasons");
    group.textContent = "";
    state.reasons.forEach(function (reason, n) {
      var button = make("button", reason, { type: "button", title: reason });
      button.prepend(make("kbd", String(n + 1)), " ");
      button.dataset.key = String(n + 1);
      button.addEventListener("click", function () { byId("reason").value = reason; });
      group.append(button);
    });
  }

  // -- Deciding. --
  function decision(names, seen) {
    var comment = byId("comment").value, what = change || (comment ? "reviewed" : null), scope = byId("scope").value;
    if (!what) { problem("Choose what becomes of the points first."); return null; }
    var points = byId("points").value.trim().replace(",", ".");
    var refused = what === "set" ? unfit(points) : "";
    if (refused) { problem(refused + " Nothing was saved. Enter a number from 0 to " + possible() + "."); byId("points").focus(); return null; }
    if (what !== "reviewed" && !byId("reason").value.trim()) { problem("A change of points needs a reason."); byId("reason").focus(); return null; }
    var id = scope === "criterion" ? current.criterion : scope ? current.part.id : "";
    return { names: names, level: scope, id: id, change: what, points: what === "set" ? points : null, comment: comment, reason: byId("reason").value, seen: seen };
  }
  // Why points cannot be given as they were typed; empty if they can.
  function unfit(points) {
    var typed = " You typed " + byId("points").value.trim() + ".";
    if (points === "") { return "How many points?"; }
    if (!/^[-+]?\d+(\.\d*)?$/.test(points)) { return "This is not a number of points." + typed; }
    if (Number(points) > possible()) { return "At most " + possible() + " points are possible here." + typed; }
    if (Number(points) < 0) { return "Fewer than 0 points are not possible." + typed; }
    if (/\.\d{3}/.test(points)) { return "Points have at most two decimals." + typed; }
    return "";
  }
  function problem(words) { byId("problem").textContent = words; byId("problem").hidden = false; }
  function save(names, seen) {
    var found = decision(names, seen), before = visible(), at = before.findIndex(function (i) { return i.id === current.id; });
    if (!found) { return; }
    ask("decide", found).then(function (plain) {
      var later = before.slice(at + 1).concat(before.slice(0, at)).map(function (i) { return i.id; });
      state = plain;
      delete drafts[shown.id];
      shown = null;
      var open_ids = visible().map(function (i) { return i.id; });
      var next = later.filter(function (id) { return open_ids.indexOf(id) >= 0; })[0];
      current = plain.items.filter(function (i) { return i.id === next; })[0] || null;
      if (current) { current = Object.assign({}, current, { state: "" }); }
      show(plain);
      document.activeElement.blur();
    }, function (error) { if (error.problem) { ask("queue").then(function (plain) { var words = byId("problem").textContent; show(plain); problem(words); }, function () {}); } });
  }
  byId("decision").addEventListener("submit", function (event) {
    event.preventDefault();
    var seen = {};
    seen[current.name] = byId("scope").value === "criterion" ? current.criterion_state : current.state;
    save([current.name], seen);
  });
  byId("undo").addEventListener("click", function () {
    ask("undo", {}).then(function (plain) {
      var back = plain.taken_back;
      show(plain);
      open(visible().filter(function (i) { return i.name === back.names[0] && (i.part.id === (back.id || "score") || i.criterion === back.id); })[0] || current);
    }, function () {});
  });

  // -- The same for all who made the same mistake. --
  byId("same").addEventListener("click", function () {
    var found = decision(current.same, {});
    if (!found) { return; }
    ask("preview", found).then(function (plain) {
      chosen = plain.effects;
      var body = byId("effects");
      body.textContent = "";
      chosen.forEach(function (effect) {
        var row = make("tr", ""), name = make("td", ""), label = make("label", ""), box = make("input", "", { type: "checkbox" });
        box.checked = !effect.is_decided || effect.name === current.name;
        label.append(box, " " + effect.name + (effect.is_decided ? " (decided already)" : ""));
        name.append(label);
        row.append(name, make("td", effect.part.join(" → ")), make("td", effect.whole.join(" → ")), make("td", effect.text));
        body.append(row);
      });
      byId("preview-about").textContent = (found.level === "criterion" ? state.criteria[found.id] : current.part.title) + ": " + (byId("reason").value || byId("comment").value);
      byId("preview").showModal();
      byId("save-all").focus();
    }, function () {});
  });
  byId("save-all").addEventListener("click", function () {
    var seen = {}, names = [];
    Array.prototype.forEach.call(byId("effects").querySelectorAll("input"), function (box, n) {
      if (box.checked) { names.push(chosen[n].name); seen[chosen[n].name] = chosen[n].state; }
    });
    byId("preview").close();
    if (names.length) { save(names, seen); }
  });
  byId("cancel").addEventListener("click", function () { byId("preview").close(); });

  // -- The keyboard. --
  // In a comment, Enter begins a new line.
  function label(isComment) { byId("save").querySelector("kbd").textContent = isComment ? "Ctrl Enter" : "Enter"; }
  byId("comment").addEventListener("focus", function () { label(true); });
  byId("comment").addEventListener("blur", function () { label(false); });
  byId("preview").addEventListener("keydown", function (event) {
    if (event.key === "Enter" && event.target.tagName === "INPUT") { event.preventDefault(); byId("save-all").click(); }
  });
  function typed(event) {
    if (byId("preview").open || event.ctrlKey || event.metaKey || event.altKey) {
      if (event.key === "Enter" && event.ctrlKey && !byId("preview").open) { byId("decision").requestSubmit(); }
      return;
    }
    var where = event.target.tagName, writing = where === "INPUT" || where === "TEXTAREA" || where === "SELECT";
    if (event.key === "Escape") { event.target.blur(); return; }
    if (writing || !current && event.key !== "u") { return; }
    var button = document.querySelector("#changes [data-key='" + CSS.escape(event.key) + "'], #reasons [data-key='" + CSS.escape(event.key) + "']");
    var actions = {
      j: function () { step(1); }, ArrowDown: function () { step(1); }, k: function () { step(-1); }, ArrowUp: function () { step(-1); },
      p: function () { byId("points").select(); }, r: function () { byId("reason").focus(); }, c: function () { byId("comment").focus(); },
      w: function () { var scope = byId("scope"); scope.selectedIndex = (scope.selectedIndex + 1) % scope.length; limit(); },
      s: function () { byId("same").click(); }, u: function () { byId("undo").click(); },
      Enter: function () { if (where !== "BUTTON" && where !== "A" && where !== "SUMMARY") { byId("decision").requestSubmit(); } }
    };
    if (button) { button.click(); event.preventDefault(); } else if (actions[event.key]) {
      if (event.key !== "Enter" || (where !== "BUTTON" && where !== "A" && where !== "SUMMARY")) { event.preventDefault(); }
      actions[event.key]();
    }
  }
  document.addEventListener("keydown", typed);
  // The evidence runs no script of its own; its keys are the desk's too.
  byId("evidence").addEventListener("load", function () {
    var inner = byId("evidence").contentDocument;
    if (!inner || inner.URL !== awaited) { return; }
    byId("evidence").hidden = false;
    byId("loading").hidden = true;
    inner.addEventListener("keydown", typed);
  });
  function note(text) {
    ask("pasted", { text: text }).then(function (plain) {
      show(plain);
      byId("pasted").value = "";
      byId("pasting").open = false;
      open(visible().filter(function (i) { return i.kind === "appeal" && i.name === plain.pasted.name && i.part.id === plain.pasted.id; })[0] || current);
    }, function () {});
  }
  byId("note").addEventListener("click", function () { note(byId("pasted").value); });
  // A question that is pasted outside of a field is noted at once.
  document.addEventListener("paste", function (event) {
    if (!/^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName) && !byId("preview").open) { note(event.clipboardData.getData("text/plain")); }
  });
  byId("filters").addEventListener("input", list);
  byId("filters").addEventListener("submit", function (event) { event.preventDefault(); });
  ask("queue").then(show, function () {});
})();
