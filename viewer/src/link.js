// The view in the fragment of the address, so that a link restores it.

// The token of the address, which from now on is that of the tab alone: a link does not give it on.
export function takeToken() {
  const { token } = readLink();
  if (token) sessionStorage.setItem("token", token);
  writeLink({ token: "" });
  return sessionStorage.getItem("token");
}

export function readLink() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

export function writeLink(values) {
  const kept = new URLSearchParams({ ...readLink(), ...values });
  for (const [key, value] of [...kept]) if (value === "" || value === "null") kept.delete(key);
  history.replaceState(null, "", `${location.pathname}${location.search}#${kept}`);
}

export function numbers(text, count) {
  const found = (text ?? "").split(",").map(Number);
  return found.length === count && found.every(Number.isFinite) ? found : null;
}

// A part of an IRI as a name; what is not encoded as IRIs are, as it stands.
export function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
