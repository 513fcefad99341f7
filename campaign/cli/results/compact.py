"""``clearcap compact``: merge the parts of a campaign into few files."""

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say


def compact(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Merge the part files of a campaign into a few larger files; the campaign may be running."""
    from campaign.store import open_store
    from campaign.store.repeat_sets import repeat_plans

    opened = open_store(store)
    header = opened.plan_header(opened.find(campaign))
    rows = opened.compact(header)
    repeats = {table.folder: opened.compact(table) for table in repeat_plans(opened, header)}
    results = [rows, *repeats.values()]
    resume = opened.command("resume", header.campaign_id)
    for reason in dict.fromkeys(reason for result in results for reason in result.bad.values()):
        say(f"{reason}: left as it is; compute its samples again with: {resume}")
    written = [*rows.written, *(f"{folder}/{name}" for folder, result in repeats.items() for name in result.written)]
    removed, files = sum(result.removed for result in results), sum(result.files for result in results)
    if json:
        document = {"campaign": header.campaign_id, "store": opened.url, "written": written}
        print_json({**document, "removed": removed, "files": files, "bad_batches": sorted(rows.bad)})
        return
    merged = f"{removed} files merged into {len(written)}"
    print_text(f"{header.campaign_id}: {merged}; the campaign has {files} files of rows now")
