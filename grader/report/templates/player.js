(function () {
  // Whole numbers, each as its difference from the one above it: see grader/report/figures/posture.py.
  function decoded(text, width) {
    var rows = [], above = new Array(width).fill(0), row = [], bits = 0, shift = 0;
    for (var n = 0; n < text.length; n++) {
      var five = text.charCodeAt(n) - 63;
      bits |= (five & 31) << shift;
      shift += 5;
      if (five & 32) { continue; }
      row.push(above[row.length] + (bits & 1 ? ~(bits >> 1) : bits >> 1));
      bits = shift = 0;
      if (row.length === width) { rows.push(row); above = row; row = []; }
    }
    return rows;
  }
  function between(a, b, share) { return a.map(function (value, n) { return value + (b[n] - value) * share; }); }

  Array.prototype.forEach.call(document.querySelectorAll(".player"), function (player) {
    var data = player.dataset, width = 3 * data.points;
    var rows = decoded(data.frames, 1 + width), ghosts = decoded(data.ghost, width), first = rows.length - ghosts.length;
    var times = rows.map(function (row) { return row[0]; }), solids = rows.map(function (row) { return row.slice(1); });
    var find = function (name) { return player.querySelector(name); };
    var links = player.querySelectorAll(".link"), joints = player.querySelectorAll(".joint");
    var box = find(".chart").viewBox.baseVal, scale = 0.72 * box.height / 2000;
    var slider = find(".time"), clock = find(".clock"), playing = find(".play"), slower = find(".speed");
    var start = times[0], now = times[+data.still], speed = 1, last = null;
    var turn = +data.turn, rise = +data.rise, views = [[turn, rise], [-90, 0], [0, 0], [-90, 90]], view = 0;
    var calm = window.matchMedia("(prefers-reduced-motion: reduce)");

    // Where the points of a posture are in the picture, as `projected` there.
    function seen(posture) {
      var t = turn * Math.PI / 180, r = rise * Math.PI / 180, places = [];
      for (var n = 0; n < posture.length; n += 3) {
        var x = posture[n], y = posture[n + 1], z = posture[n + 2];
        places.push([
          box.width / 2 + scale * (y * Math.cos(t) - x * Math.sin(t)),
          (0.8 - 0.3 * rise / 90) * box.height - scale * (z * Math.cos(r) - (x * Math.cos(t) + y * Math.sin(t)) * Math.sin(r))
        ]);
      }
      return places;
    }
    function line(name, posture) {
      var points = seen(posture).map(function (place) { return place[0].toFixed(1) + "," + place[1].toFixed(1); });
      find(name).setAttribute("points", points.join(" "));
    }
    // The way that the last point took in the two seconds before frame n.
    function way(name, frames, n) {
      var points = [], from = times.length - frames.length;
      for (var k = n - from; k >= 0 && times[k + from] > now - 2000; k--) { points.push(frames[k].slice(-3)); }
      line(name, [].concat.apply([], points));
    }
    function look() {
      var reach = [], ends = [];
      for (var n = -4; n <= 4; n++) { reach.push(500 * n); }
      reach.forEach(function (at) { ends.push(at, -2000, 0, at, 2000, 0, -2000, at, 0, 2000, at, 0); });
      var path = seen(ends).map(function (p, n) { return (n % 2 ? "L" : "M") + p[0].toFixed(0) + " " + p[1].toFixed(0); });
      find(".floor").setAttribute("d", path.join(""));
      show();
    }
    function show() {
      var n = 0;
      while (n < times.length - 2 && times[n + 1] <= now) { n++; }
      var share = Math.max(0, Math.min(1, (now - times[n]) / Math.max(1, times[n + 1] - times[n])));
      var posture = between(solids[n], solids[n + 1], share), places = seen(posture);
      for (var i = 0; i < links.length; i++) {
        links[i].x1.baseVal.value = places[i][0]; links[i].y1.baseVal.value = places[i][1];
        links[i].x2.baseVal.value = places[i + 1][0]; links[i].y2.baseVal.value = places[i + 1][1];
      }
      for (i = 0; i < joints.length; i++) {
        joints[i].cx.baseVal.value = places[i][0]; joints[i].cy.baseVal.value = places[i][1];
      }
      line(".shadow", posture.map(function (value, k) { return k % 3 === 2 ? 0 : value; }));
      way(".way", solids, n);
      way(".ghost-way", ghosts, n);
      var at = n - first;
      line(".ghost", at >= 0 ? between(ghosts[at], ghosts[at + 1], share) : []);
      slider.value = now;
      clock.textContent = (now / 1000).toFixed(2) + " s";
      slider.setAttribute("aria-valuetext", clock.textContent);
    }
    function go(to) { now = Math.max(start, Math.min(times[times.length - 1], to)); show(); }
    // One posture on or back.
    function step(by) {
      pause();
      var n = 0;
      while (n < times.length - 1 && times[n + 1] <= now + 0.5) { n++; }
      if (by < 0 && now > times[n] + 0.5) { by = 0; }
      go(times[Math.max(0, Math.min(times.length - 1, n + by))]);
    }
    function pause() { last = null; playing.textContent = "▶"; playing.setAttribute("aria-label", "Play"); }
    function play() {
      if (now >= times[times.length - 1]) { now = start; }
      playing.textContent = "❚❚";
      playing.setAttribute("aria-label", "Pause");
      last = performance.now();
      requestAnimationFrame(tick);
    }
    function tick(at) {
      if (last === null) { return; }
      // Where less motion is wanted, still after still.
      if (!calm.matches || at - last >= 500) { go(now + Math.max(0, at - last) * speed); last = at; }
      if (now >= times[times.length - 1]) { pause(); } else { requestAnimationFrame(tick); }
    }
    function toggle() { if (last === null) { play(); } else { pause(); } }

    slider.min = start;
    slider.max = times[times.length - 1];
    find(".controls").hidden = false;
    playing.addEventListener("click", toggle);
    find(".back").addEventListener("click", function () { step(-1); });
    find(".on").addEventListener("click", function () { step(1); });
    slider.addEventListener("input", function () { pause(); go(+slider.value); });
    slider.addEventListener("keydown", function (event) {
      if (event.key === " ") { event.preventDefault(); toggle(); }
    });
    slower.addEventListener("click", function () {
      speed = speed === 1 ? 0.25 : 1;
      slower.textContent = speed === 1 ? "1×" : "¼×";
      slower.setAttribute("aria-label", speed === 1 ? "Speed: as it was" : "Speed: a quarter");
    });
    find(".view").addEventListener("click", function () {
      view = (view + 1) % views.length;
      turn = views[view][0]; rise = views[view][1];
      look();
    });
    // Without this script there is nothing to be pressed.
    Array.prototype.forEach.call(player.querySelectorAll(".at"), function (said) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = said.textContent;
      button.addEventListener("click", function () { pause(); go(+said.dataset.at); });
      said.replaceWith(button);
    });
    var held = null, stage = find(".chart");
    stage.addEventListener("pointerdown", function (event) {
      held = [event.clientX, event.clientY, turn, rise];
      stage.setPointerCapture(event.pointerId);
    });
    stage.addEventListener("pointermove", function (event) {
      if (!held) { return; }
      turn = held[2] - (event.clientX - held[0]) / 3;
      rise = Math.max(0, Math.min(90, held[3] + (event.clientY - held[1]) / 3));
      look();
    });
    stage.addEventListener("pointerup", function () { held = null; });
    stage.addEventListener("pointercancel", function () { held = null; });
    show();
  });
})();
