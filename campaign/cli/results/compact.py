"""``clearcap compact``: the parts of a campaign in few files."""

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say


def compact(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Merge the part files of a campaign into a few larger files; the campaign may be running."""
    from campaign.store import open_store

    opened = open_store(store)
    header = opened.plan_header(opened.find(campaign))
    result = opened.compact(header)
    resume = opened.command("resume", header.campaign_id)
    for reason in dict.fromkeys(result.bad.values()):
        say(f"{reason}: left as it is; compute its samples again with: {resume}")
    if json:
        document = {"campaign": header.campaign_id, "store": opened.url, "written": result.written}
        print_json({**document, "removed": result.removed, "files": result.files, "bad_batches": sorted(result.bad)})
        return
    merged = f"{result.removed} files merged into {len(result.written)}"
    print_text(f"{header.campaign_id}: {merged}; the campaign has {result.files} files of rows now")
