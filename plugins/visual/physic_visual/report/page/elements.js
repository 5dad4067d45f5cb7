// Small helpers: elements with text that is never parsed as markup, and numbers as text.

const byId = name => document.getElementById(name);

function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("aria-")) made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children.filter(child => child !== null));
  return made;
}

// Text in which no option of the command is broken between two lines.
const withOptions = text => text.split(/(--[\w-]+)/).map((part, i) => (i % 2 ? element("code", { textContent: part }) : part));

// A length and, where the deviation of its logarithm is known, its own.
const meters = (value, sigma = null) => value === null ? "unknown"
  : `${value.toFixed(2).replace(/^-(0\.00)$/, "$1")}${sigma === null ? "" : ` ± ${(sigma * Math.abs(value)).toFixed(2)}`} m`;
const percent = value => `${(100 * value).toFixed(value < 0.1 ? 1 : 0)} %`;
const words = name => name.replaceAll("_", " ");
const cssColor = ([red, green, blue]) => `rgb(${red} ${green} ${blue})`;
