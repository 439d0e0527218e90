// Excerpts of the pages found come from TEXTS (see excerpts.py), since a page from a disk cannot fetch them.
window.fetch = async (page) => new Response(TEXTS[page]);

Search.htmlToText = (html, anchor) => {
  const page = new DOMParser().parseFromString(html, "text/html");
  return (page.getElementById(anchor?.slice(1)) ?? page.body).textContent;
};

// A stem is not always the beginning of the word: "choleski" for Cholesky. Sphinx takes the last that it finds.
const summaryOfStems = Search.makeSearchSummary;
Search.makeSearchSummary = (html, stems, anchor) =>
  summaryOfStems(html, [...stems].flatMap((stem) => [stem.slice(0, -1), stem]), anchor);
