# Every call of the HTTP API, one after the other. Set AUTH, URL, and ID and OTHER (two finished campaigns) first:
# AUTH="Authorization: Bearer clearcap_token_..." URL=https://clearcap.example
# NEW is the id of the campaign that is submitted here, PARTS that of the measured parts that are sent, CONTENT what is
# answered before a sign-off.

## Mechanisms and new campaigns over the API

curl -H "$AUTH" "$URL/api/v1/mechanisms"
curl -H "$AUTH" "$URL/api/v1/mechanisms/c60/text" -o mine.toml
curl -H "$AUTH" "$URL/api/v1/mechanisms/c60"
curl -H "$AUTH" "$URL/api/v1/mechanisms/c60/picture.svg" -o c60.svg
python3 -c 'import json; print(json.dumps({"text": open("mine.toml").read()}))' > mine.json
curl -H "$AUTH" "$URL/api/v1/checks/mechanism" --json @mine.json
curl -H "$AUTH" -X PUT "$URL/api/v1/mechanisms/mine" --json @mine.json
curl -H "$AUTH" "$URL/api/v1/simulations" --json '{"mechanism": "c60", "values": {"J1": 0.05}}'
curl -H "$AUTH" "$URL/api/v1/simulations/c60/motion.gif?set=J1=0.05" -o c60.gif

curl -H "$AUTH" "$URL/api/v1/drawings" -F name=latch -F file=@latch.step
curl -H "$AUTH" "$URL/api/v1/drawings/latch" -o draft.json
curl -H "$AUTH" "$URL/api/v1/drawings/latch/found.html" -o found.html
python3 -c 'import json; d = json.load(open("draft.json")); print(json.dumps({k: d[k] for k in ("text", "version")}))' > text.json
curl -H "$AUTH" "$URL/api/v1/drawings/latch/check" --json @text.json
curl -H "$AUTH" "$URL/api/v1/drawings/latch" -X PUT --json @text.json
curl -H "$AUTH" "$URL/api/v1/drawings/latch/groups" --json "$(sed 's/: 1}/: 2}/' text.json)"
curl -H "$AUTH" "$URL/api/v1/drawings/latch/mechanism" --json "$(sed 's/: 1}/: 4}/' text.json)"

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/campaign.toml" -o mine.toml
curl -H "$AUTH" "$URL/api/v1/checks/campaign" -F campaign=@mine.toml
curl -H "$AUTH" -H "Idempotency-Key: night-1" "$URL/api/v1/campaigns" -F campaign=@mine.toml -F seed=3 -F tags=night

curl -H "$AUTH" "$URL/api/v1/campaigns?state=completed&limit=20"
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW"
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW/status"
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW/labels" -X PATCH --json '{"add_tags": ["release-3"], "note": "first try"}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW/cancel" -X POST
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW/resume" -X POST
curl -H "$AUTH" "$URL/api/v1/campaigns/$NEW" -X DELETE -H "X-Confirm: $NEW"
curl -H "$AUTH" --no-buffer "$URL/api/v1/campaigns/$ID/events"

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/extend" --json '{"samples": 60}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/rerun" --json '{"statuses": ["crashed"]}'

## Users, tokens and the audit trail

curl -H "$AUTH" "$URL/api/v1/users"
curl -H "$AUTH" "$URL/api/v1/users/bob" -X PATCH --json '{"disabled": true}'
curl -H "$AUTH" "$URL/api/v1/users/bob/access" -X DELETE
curl -H "$AUTH" "$URL/api/v1/audit?object=bob&limit=20"
curl -H "$AUTH" "$URL/api/v1/audit/check"
curl -H "$AUTH" "$URL/api/v1/account"
curl -H "$AUTH" "$URL/api/v1/tokens"
curl -H "$AUTH" "$URL/api/v1/tokens?everyone=true"
curl -H "$AUTH" "$URL/api/v1/tokens/1" -X DELETE
curl -H "$AUTH" "$URL/api/v1/account/sessions" -X DELETE

## Shared links

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/shares" --json '{"days": 14, "note": "the review"}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/shares"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/shares/1" -X DELETE

## Questions about finished rows

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/whatif?set=J1.std=0.018&preview=true"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/whatif" --json '{"set": ["J1.std=0.018"]}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/histogram?response=FC-1&set=J1.std=0.018"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/advice"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/allocation" --json '{"costs": "[variables.J1]\ncost = 1.0\n"}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/confirmation" --json '{"costs": "[variables.J1]\ncost = 1.0\n"}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/comparisons/$OTHER"
curl -H "$AUTH" -X POST "$URL/api/v1/campaigns/$ID/comparisons/$OTHER"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/pools" --json '{"others": ["'$OTHER'"]}'
curl -H "$AUTH" -X POST "$URL/api/v1/campaigns/$ID/report"

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/reports"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/reports/own/report.html" -o report.html
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/reports/against/$OTHER/report.html" -o comparison.html
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/reports/pooled/$OTHER/report.html" -o pooled.html
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/rows?format=parquet" -o rows.parquet
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/rows?format=csv&columns=sample&columns=FC-1&status=ok&last=999"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples?sort=margin&limit=20"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples?sort=sample&status=failed"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples?sort=-FC-1&range=J1:0.06:"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples/3"
curl -H "$AUTH" -X POST "$URL/api/v1/campaigns/$ID/samples/3/replay"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples/3/plot.svg" -o plot.svg
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples/3/motion.gif" -o motion.gif
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/samples/3/motion.json" -o motion.json

## Measured parts

curl -H "$AUTH" "$URL/api/v1/measured" -F file=@parts.csv -F limits=@limits.toml
curl -H "$AUTH" "$URL/api/v1/measured?limit=20"
curl -H "$AUTH" "$URL/api/v1/measured/$PARTS"
curl -H "$AUTH" "$URL/api/v1/measured/$PARTS/files/report.html" -o measured.html
curl -H "$AUTH" "$URL/api/v1/measured/$PARTS" -X DELETE
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/monitor" -F file=@night.csv
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/monitor"

## Webhooks

curl -H "$AUTH" "$URL/api/v1/webhooks"
curl -H "$AUTH" "$URL/api/v1/webhooks/1"
curl -H "$AUTH" "$URL/api/v1/webhooks/1" -X DELETE

## Sign-off

curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs/content"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs" --json '{"content": "'$CONTENT'", "comment": "as drawn"}'
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs?check=true"
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs/export.zip" -o signed.zip
curl -H "$AUTH" "$URL/api/v1/campaigns/$ID/signoffs/withdrawal" --json '{"comment": "wrong drawing"}'
curl -H "$AUTH" "$URL/api/v1/signing-key"

## Watching the server

curl "$URL/healthz"
curl "$URL/readyz"
curl -H "$AUTH" "$URL/metrics"
