// The timelines of sessions: a click or an arrow key leads to a moment, its line of the log and its time in the bag.
(function () {
  var MOST = 64;
  var each = parts.each;
  function add(parent, name, text) {
    var made = document.createElement(name);
    made.textContent = text;
    parent.appendChild(made);
    return made;
  }
  parts.whenBuilt(function (root) { each(root, ".timeline", begin); });
  function begin(timeline) {
    var length = Number(timeline.dataset.length), started = timeline.dataset.started, session = timeline.dataset.session;
    var scroll = timeline.querySelector(".tl-scroll"), wide = timeline.querySelector(".tl-wide");
    var picture = timeline.querySelector(".tl-picture"), read = timeline.querySelector(".tl-read");
    var rows = Array.prototype.slice.call(timeline.querySelectorAll("tr[data-at]"));
    var zoom = 1, chosen = -1, cursor = ruler("tl-cursor"), hover = ruler("tl-hover");
    timeline.querySelector(".tl-tools").hidden = false;

    function ruler(name) {
      var made = picture.appendChild(document.createElementNS(picture.namespaceURI, "line"));
      made.setAttribute("class", name);
      made.setAttribute("y1", "18");
      made.setAttribute("y2", "100%");
      made.setAttribute("visibility", "hidden");
      return made;
    }
    function put(line, at) {
      var x = 100 * at / length + "%";
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
      line.setAttribute("visibility", "visible");
    }
    // Round times, as many as there is room for.
    function ticks() {
      var raw = length / Math.max(2, picture.clientWidth / 90), power = Math.pow(10, Math.floor(Math.log10(raw)));
      var step = [1, 2, 5, 10].find(function (m) { return m * power >= raw * 0.999; }) * power;
      var digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
      each(picture, ".tl-when", function (old) { old.remove(); });
      for (var n = 0; n * step <= length * (1 + 1e-9); n += 1) {
        var line = picture.insertBefore(document.createElementNS(picture.namespaceURI, "line"), picture.firstChild);
        line.setAttribute("class", "tl-grid tl-when");
        line.setAttribute("y1", "22");
        line.setAttribute("y2", "100%");
        put(line, n * step);
        var text = picture.appendChild(document.createElementNS(picture.namespaceURI, "text"));
        text.setAttribute("class", "tl-when");
        text.setAttribute("x", 100 * n * step / length + "%");
        text.setAttribute("y", "12");
        text.setAttribute("text-anchor", n === 0 ? "start" : n * step > length * 0.97 ? "end" : "middle");
        text.textContent = (n * step).toFixed(digits);
      }
    }
    // Nanoseconds since 1970 are more than a number holds exactly.
    function inBag(at) {
      var micros = Math.round(at * 1e6) + Number(started.slice(-9)) / 1e3, whole = Number(started.slice(0, -9));
      return (whole + Math.floor(micros / 1e6)) + "." + String(Math.round(micros % 1e6 / 1e3) % 1000).padStart(3, "0");
    }
    // A dragged span, or one between the keys [ and ], leaves output, moments and the light part of figures within it.
    var span = null, brushed = false, brush = picture.appendChild(document.createElementNS(picture.namespaceURI, "rect"));
    brush.setAttribute("class", "tl-brush");
    brush.setAttribute("height", "100%");
    function within(from, to) { return !span || from <= span[1] && to >= span[0]; }
    function draw() {
      brush.setAttribute("x", 100 * (span ? span[0] : 0) / length + "%");
      brush.setAttribute("width", 100 * (span ? span[1] - span[0] : 0) / length + "%");
    }
    function veil(chart) {
      each(chart, ".veil", function (old) { old.remove(); });
      var axis = chart.dataset.time.split(" ").map(Number), left = axis[0], right = axis[1];
      function x(at) { return Math.min(right, Math.max(left, left + (right - left) * (at - axis[2]) / (axis[3] - axis[2]))); }
      (span ? [[left, x(span[0])], [x(span[1]), right]] : []).forEach(function (side) {
        var made = chart.appendChild(document.createElementNS(chart.namespaceURI, "rect"));
        made.setAttribute("class", "veil");
        made.setAttribute("x", side[0]);
        made.setAttribute("width", side[1] - side[0]);
        made.setAttribute("height", "100%");
      });
    }
    function limit(from, to) {
      span = from === null ? null : [Math.min(from, to), Math.max(from, to)];
      draw();
      parts.buildAll();
      each(timeline.closest(".session"), ".out", function (line) {
        var at = parseFloat(line.firstChild.textContent);
        line.classList.toggle("outside", !within(at, at));
      });
      rows.forEach(function (row) { row.classList.toggle("outside", !within(Number(row.dataset.at), Number(row.dataset.to || row.dataset.at))); });
      each(document, "figure[data-session]", function (figure) {
        if (figure.dataset.session === session) { each(figure, "[data-time]:not([data-time=''])", veil); }
      });
      tell();
    }
    function tell() {
      read.textContent = span ? "Only " + span[0].toFixed(3) + "–" + span[1].toFixed(3) + " s: output, moments and figures. " : "The whole session.";
      if (!span) { return; }
      var button = add(read, "button", "whole session");
      button.type = "button";
      button.addEventListener("click", function () { limit(null); });
    }
    picture.addEventListener("dragstart", function (event) { event.preventDefault(); });
    picture.addEventListener("pointerdown", function (down) {
      if (down.button !== 0 || down.pointerType === "touch") { return; }
      var from = timeAt(down);
      brushed = false;
      function move(event) {
        if (!brushed && Math.abs(event.clientX - down.clientX) < 5) { return; }
        brushed = true;
        span = [Math.min(from, timeAt(event)), Math.max(from, timeAt(event))];
        draw();
      }
      document.addEventListener("pointermove", move);
      document.addEventListener("pointerup", function (event) {
        document.removeEventListener("pointermove", move);
        if (brushed) { limit(from, timeAt(event)); }
      }, {once: true});
    });
    function timeAt(event) {
      var box = picture.getBoundingClientRect();
      return Math.min(length, Math.max(0, (event.clientX - box.left) / box.width * length));
    }
    // The first line that the session's programs wrote from then on.
    function lineAt(at) {
      var found = null, best = Infinity;
      each(timeline.closest(".session"), ".out", function (line) {
        var written = parseFloat(line.firstChild.textContent);
        if (written >= at - 0.0005 && written < best) { best = written; found = line; }
      });
      return found;
    }
    function show(line) {
      each(document, ".out.on", function (other) { other.classList.remove("on"); });
      parts.show(line);
      line.classList.add("on");
      line.scrollIntoView({block: "center"});
    }
    function choose(at, words, line) {
      put(cursor, at);
      read.textContent = "";
      add(read, "b", at.toFixed(3) + " s");
      read.append(words ? " " + words + " · bag time " : " · bag time ");
      add(read, "b", inBag(at));
      read.append(" · ");
      add(read, "code", "grade play . " + session + " --from " + at.toFixed(3));
      line = line || lineAt(at);
      if (line) {
        read.append(" · ");
        var button = add(read, "button", "log");
        button.type = "button";
        button.addEventListener("click", function () { show(line); });
      }
    }
    function moment(number, inList) {
      var row = rows[number], link = row.querySelector(".tl-log"), at = Number(row.dataset.at);
      chosen = number;
      each(timeline, ".on", function (e) { e.classList.remove("on"); });
      row.classList.add("on");
      each(picture, 'a[href="#' + row.id + '"]', function (e) { e.classList.add("on"); });
      choose(at, [row.cells[2].textContent, row.cells[3].textContent].filter(Boolean).join(": "), link && document.getElementById(link.hash.slice(1)));
      var box = row.closest(".scroll");
      if (!inList) { box.scrollTop = row.offsetTop - box.clientHeight / 3; }
      var x = at / length * wide.clientWidth;
      if (x < scroll.scrollLeft || x > scroll.scrollLeft + scroll.clientWidth) { scroll.scrollLeft = x - scroll.clientWidth / 2; }
    }
    function scale(factor, at) {
      var before = at === undefined ? scroll.scrollLeft + scroll.clientWidth / 2 : at / length * wide.clientWidth;
      var share = before / wide.clientWidth, aside = before - scroll.scrollLeft;
      zoom = Math.min(MOST, Math.max(1, zoom * factor));
      wide.style.width = 100 * zoom + "%";
      ticks();
      scroll.scrollLeft = share * wide.clientWidth - aside;
    }
    rows.forEach(function (row) {
      var words = Array.prototype.map.call(row.cells, function (cell) { return cell.textContent; });
      var title = document.createElementNS(picture.namespaceURI, "title");
      title.textContent = words[0] + " s: " + [words[2], words[3]].filter(Boolean).join(". ");
      picture.querySelector('a[href="#' + row.id + '"]').prepend(title);
    });
    new ResizeObserver(ticks).observe(scroll);
    scroll.tabIndex = 0;
    scroll.setAttribute("role", "group");
    scroll.setAttribute("aria-label", "Timeline of " + session + ": arrow keys go from moment to moment, plus and minus zoom, brackets limit the time");
    scroll.addEventListener("keydown", function (event) {
      var step = {ArrowRight: 1, ArrowLeft: -1, Home: -rows.length, End: rows.length}[event.key];
      if (step) { moment(Math.min(rows.length - 1, Math.max(0, chosen + step))); }
      else if (event.key === "+") { scale(2, chosen < 0 ? undefined : Number(rows[chosen].dataset.at)); }
      else if (event.key === "-") { scale(0.5); }
      else if (event.key === "Escape" && span) { limit(null); }
      else if (chosen >= 0 && event.key === "[") { limit(Number(rows[chosen].dataset.at), span ? span[1] : length); }
      else if (chosen >= 0 && event.key === "]") { limit(span ? span[0] : 0, Number(rows[chosen].dataset.at)); }
      else { return; }
      event.preventDefault();
    });
    picture.addEventListener("click", function (event) {
      var link = event.target.closest("a");
      event.preventDefault();
      if (brushed) { return; }
      if (link) { moment(rows.findIndex(function (row) { return "#" + row.id === link.getAttribute("href"); })); }
      else { choose(timeAt(event)); }
    });
    picture.addEventListener("mousemove", function (event) { put(hover, timeAt(event)); });
    picture.addEventListener("mouseleave", function () { hover.setAttribute("visibility", "hidden"); });
    scroll.addEventListener("wheel", function (event) {
      if (!event.ctrlKey) { return; }
      event.preventDefault();
      scale(event.deltaY < 0 ? 1.25 : 0.8, timeAt(event));
    }, {passive: false});
    rows.forEach(function (row, number) {
      row.addEventListener("click", function (event) { if (!event.target.closest("a")) { moment(number, true); } });
    });
    timeline.querySelector(".tl-in").addEventListener("click", function () { scale(2); });
    timeline.querySelector(".tl-out").addEventListener("click", function () { scale(0.5); });
  }
})();
