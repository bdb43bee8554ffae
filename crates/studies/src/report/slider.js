(function () {
  "use strict";
  var slider = document.querySelector(".slider");
  if (!slider) return;
  slider.classList.add("on");
  var stage = slider.querySelector(".stage");
  slider.querySelector("input").addEventListener("input", function (event) {
    stage.style.setProperty("--cut", event.target.value + "%");
  });
  slider.querySelectorAll("select").forEach(function (select) {
    var shown = document.getElementById(select.dataset.shows);
    var choose = function () {
      var picture = document.getElementById(select.value);
      shown.src = picture.src;
      shown.alt = picture.alt;
    };
    select.addEventListener("change", choose);
    choose();
  });
})();
