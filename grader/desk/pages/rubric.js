"use strict";
(function () {
  var byId = function (id) { return document.getElementById(id); }, limits = [];
  function make(tag, text) { var element = document.createElement(tag); element.textContent = text; return element; }
  function ask(path, body) {
    var how = body ? { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) } : {};
    return fetch(path, how).then(function (answer) {
      return answer.json().then(function (plain) {
        byId("problem").hidden = answer.ok;
        if (answer.ok) { return plain; }
        byId("problem").textContent = [plain.problem + "."].concat(plain.mistakes, plain.remedy).join("\n");
        throw plain;
      });
    });
  }
  function moved() {
    var values = {};
    limits.forEach(function (l) { if (l.input.value.trim() !== l.value) { values[l.id] = l.input.value.trim(); } });
    return values;
  }
  ask("rubric").then(function (plain) {
    limits = plain.limits;
    var criterion = null, check = null, row = null;
    limits.forEach(function (limit) {
      if (limit.criterion !== criterion) { byId("limits").append(make("h2", limit.criterion)); criterion = limit.criterion; }
      if (limit.check !== check) {
        var heading = make("h3", limit.title + " ");
        heading.append(make("code", limit.check));
        row = make("div", "");
        row.className = "row";
        byId("limits").append(heading, row);
        check = limit.check;
      }
      var label = make("label", limit.key.replace(/_/g, " ") + " ");
      limit.input = document.createElement("input");
      limit.input.value = limit.value;
      limit.input.addEventListener("input", function () { limit.input.className = limit.input.value.trim() === limit.value ? "" : "moved"; });
      limit.input.addEventListener("change", function () { byId("preview").click(); });
      label.append(limit.input);
      row.append(label);
    });
  });
  byId("preview").addEventListener("click", function () {
    byId("said").textContent = "Judging …";
    ask("rubric/preview", moved()).then(function (plain) {
      byId("said").textContent = plain.changes.length + " of " + plain.judged + " would change." + (plain.failed.length ? " Could not be judged: " + plain.failed.join(", ") : "");
      byId("changes").textContent = "";
      plain.changes.forEach(function (change) {
        var row = make("tr", "");
        row.append(make("td", change.name), make("td", (change.before === null ? "none" : change.before) + " → " + change.after), make("td", change.difference), make("td", change.parts.join(", ")));
        byId("changes").append(row);
      });
    }, function () { byId("said").textContent = ""; });
  });
  byId("save").addEventListener("click", function () {
    ask("rubric/save", moved()).then(function (plain) {
      byId("said").textContent = "Saved as " + plain.saved;
      byId("command").textContent = plain.command;
      byId("applying").hidden = false;
      copy();
    }, function () {});
  });
  // A browser that refuses the clipboard still shows the command.
  function copy() {
    navigator.clipboard.writeText(byId("command").textContent).then(function () { byId("said").textContent += " The command is copied."; }, function () {});
  }
  byId("copy").addEventListener("click", copy);
})();
