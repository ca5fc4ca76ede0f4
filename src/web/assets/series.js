// Lines of results from the API.

const of = ({ series }, path, query) => {
  const search = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== undefined && value !== null));
  return fetch(`/api/v1/series/${series}/${path}?${search}`);
};

/** The API's points with `at` in seconds since 1970, which rises: two of one instant are told apart by a microsecond. */
function timed(list) {
  let last = -Infinity;
  for (const point of list) {
    const at = Date.parse(point.created_at) / 1000;
    point.at = last = at > last ? at : last + 1e-6;
  }
  return list;
}

/** What there is of a line between two moments (milliseconds), thinned to at most `max` points that keep every peak. */
export async function points(line, metric, { from, to, max }) {
  const response = await of(line, "points", { metric, branch: line.branch, since_ms: from, until_ms: to, max_points: max });
  if (!response.ok) return { nPoints: 0, list: [] };
  const { n_points: nPoints, points: list } = await response.json();
  return { nPoints, list: timed(list) };
}

/** Limits, baseline and changes of level; nothing where they cannot be had. */
export async function marks(line, metric) {
  const response = await of(line, "marks", { metric, branch: line.branch });
  return response.ok ? response.json() : null;
}

/** One line minus another, where both have a result: of the same commit, else of the newest before. */
export async function difference(a, b, metric, { from, to }) {
  const [left, right] = await Promise.all([a, b].map((line) => points(line, metric, { from, to })));
  const byCommit = new Map(right.list.filter((p) => p.commit).map((p) => [p.commit, p]));
  let next = 0;
  const found = [];
  for (const point of left.list) {
    while (next < right.list.length && right.list[next].at <= point.at) next++;
    const other = byCommit.get(point.commit) ?? right.list[next - 1];
    if (!other || typeof point.value !== "number" || typeof other.value !== "number") continue;
    found.push({ ...point, value: point.value - other.value, other: other.report_id });
  }
  return found;
}
