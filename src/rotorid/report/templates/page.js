(function () {
  "use strict";
  var plots = JSON.parse(document.getElementById("plots").textContent);
  var touched = window.matchMedia("(pointer: coarse)").matches;
  var settings = {
    responsive: true, displaylogo: false, showTips: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
    toImageButtonOptions: {format: "svg", filename: "rotorid"}
  };
  var waiting = Array.prototype.slice.call(document.querySelectorAll(".plot"));
  var places = waiting.slice();

  function draw(place) {
    var plot = plots[place.id];
    // The place holds the height: what answers to a new width forgets that of the layout.
    place.style.height = plot.layout.height + "px";
    delete plot.layout.height;
    if (touched) { plot.layout.dragmode = false; }
    Plotly.newPlot(place, plot.data, plot.layout, settings);
  }
  function some(until) {
    while (waiting.length && performance.now() < until) { draw(waiting.shift()); }
  }
  function later() {
    some(performance.now() + 60);
    if (waiting.length) { setTimeout(later, 0); }
  }
  function fit() {
    places.forEach(function (place) {
      Plotly.relayout(place, {width: place.clientWidth, height: place.clientHeight});
    });
  }
  some(performance.now() + 1500);
  later();
  window.addEventListener("beforeprint", function () {
    some(Infinity);
    document.body.classList.add("printing");
    fit();
  });
  window.addEventListener("afterprint", function () {
    document.body.classList.remove("printing");
    places.forEach(function (place) {
      Plotly.relayout(place, {width: null, height: null, autosize: true});
    });
  });
})();
