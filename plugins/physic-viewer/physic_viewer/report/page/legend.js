// The legend of contact in the 3D view: the colours that the bodies show now, and what is touched.

function showLegend(list, data, isOn) {
  const any = [{ label: "anything", color: data.colors.contact }];
  const entries = data.legend.length && !isOn("partners") ? any : data.legend;
  list.hidden = !entries.length || !isOn("contact") || !isOn("people");
  list.replaceChildren(element("li", { className: "soft", textContent: "Contact with" }), ...entries.map(({ label, color }) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = cssColor(color);
    return element("li", {}, dot, label);
  }));
}
